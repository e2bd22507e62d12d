"""Make the ground of a map, obstacles, keep-out zones and fences, grown by the robot's radius."""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FlagArray, FloatArray
from estimator.filter import Area
from estimator.maps.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from planner.ground.frame import MARGIN, OPEN, SOLID, TIGHT
from planner.ground.grid_ground import GridGround
from planner.ground.shapes import Shape
from planner.ground.walk import squared_distances

CELLS = 250  # along the longest side where no resolution is given and there is no map
LAYERED_CELLS = 80  # the same where altitude counts
MAX_CELLS = 20_000_000
BEYOND = 0.1  # without a map and a fence the ground reaches this share of the longest side beyond the area


@dataclass(frozen=True, slots=True, eq=False)
class GroundPlan:
    """What the ground is made of."""

    map: OccupancyMap | None = None  # what is not free on it is no way
    obstacles: tuple[Shape, ...] = ()
    keep_out: tuple[Shape, ...] = ()
    fences: tuple[Shape, ...] = ()  # robots stay inside at least one of them; none: no fence
    radius: float = 0.0  # metres from a robot's middle that nothing may come into
    room: float = 0.0  # metres beyond the radius that ways keep where there is room
    resolution: float | None = None  # metres per cell; None: the map's, coarser for a large radius
    layer: float | None = None  # metres of a layer; None: the resolution
    altitude: tuple[float, float] | None = None  # that robots keep to
    climb: bool = False

    @property
    def layered(self) -> bool:
        """Whether altitude matters for where one may be."""
        return any(not shape.endless for shape in (*self.obstacles, *self.keep_out))


def built(plan: GroundPlan, area: Area, starts: FloatArray) -> GridGround:
    """The ground over an area in which robots start at `starts` (3, n).

    Raises:
        ValueError: naming the part that is wrong: a resolution with too many cells, or finer than the map's.
    """
    low, high = _altitudes(plan, area, starts)
    if plan.map is not None:
        factor = _factor(plan, plan.map)
        blocked = _coarse(plan.map.cells != FREE, factor)
        resolution, origin = factor * plan.map.resolution, plan.map.origin
    else:
        first, last = _box(plan, area, starts)
        longest = float((last - first).max())
        resolution = plan.resolution or longest / (LAYERED_CELLS if plan.layered else CELLS)
        columns, rows = (max(1, math.ceil(side / resolution - 1e-9)) for side in (last - first).tolist())
        _few_enough(rows * columns)
        blocked = np.zeros((rows, columns), dtype=np.bool_)
        origin = np.append(first, 0.0)
    layers = max(1, math.ceil((high - low) / (plan.layer or resolution) - 1e-9)) if plan.layered else 1
    _few_enough(blocked.size * layers)
    flat = np.where(blocked, SOLID, OPEN).astype(np.uint8)
    if plan.radius + plan.room > 0 and blocked.any():
        # The distance between two cells is that of their middles, with the blocked ones grown by one.
        far = squared_distances(~_thick(blocked)) * resolution**2
        flat[~blocked & (far < (plan.radius + plan.room) ** 2)] = TIGHT
        flat[~blocked & (far < plan.radius**2)] = MARGIN
    cells = np.ascontiguousarray(np.repeat(flat[None], layers, axis=0))
    middles = _middles(blocked.shape, resolution, origin)
    _fence(cells, plan, middles, resolution)
    for shape in (*plan.obstacles, *plan.keep_out):
        _block(cells, shape, plan, middles, resolution, (low, high))
    reach = plan.radius + plan.room + 3.0 * resolution
    return GridGround(cells, resolution, origin, low, high, reach, plan.climb)


def target_map(plan: GroundPlan, area: Area, ground: GridGround) -> OccupancyMap | None:
    """Where targets can be: the map, without obstacles that reach from floor to ceiling and beyond the fence.

    Keep-out zones do not matter: what lies there can be seen from outside. None: anywhere.
    """
    solids = _solids(plan, area)
    if not solids and not plan.fences:
        return plan.map
    if plan.map is not None:
        cells, resolution, origin = plan.map.cells.copy(), plan.map.resolution, plan.map.origin
    else:
        cells = np.zeros(ground.cells.shape[1:], dtype=np.uint8)
        resolution, origin = ground.resolution, ground.origin
    middles = _middles(cells.shape, resolution, origin)
    if plan.fences:
        cells[(_fenced(plan.fences, middles) >= 0.0).reshape(cells.shape)] = UNKNOWN
    for shape in solids:
        inside = shape.distances(middles) < 0.0
        cells[inside.reshape(cells.shape)] = OCCUPIED
    return OccupancyMap(cells, resolution, origin)


def _solids(plan: GroundPlan, area: Area) -> list[Shape]:
    """Obstacles with no target under or over them: in 2D all of them, in 3D those through the whole area."""
    if area.dimension == 2:
        return list(plan.obstacles)
    low, high = float(area.low[2]), float(area.high[2])
    return [shape for shape in plan.obstacles if shape.altitude[0] <= low and shape.altitude[1] >= high]


def _altitudes(plan: GroundPlan, area: Area, starts: FloatArray) -> tuple[float, float]:
    """Between which altitudes robots may be. Without limits: where anything is, and a layer more."""
    if plan.altitude is not None:
        return plan.altitude
    if not plan.layered:
        return -np.inf, np.inf
    ends = [x for s in (*plan.obstacles, *plan.keep_out) for x in s.altitude if math.isfinite(x)]
    ends += starts[2].tolist() + ([float(area.low[2]), float(area.high[2])] if area.dimension == 3 else [])
    more = 2.0 * plan.radius + (plan.layer or plan.resolution or 0.1 * (max(ends) - min(ends)) or 1.0)
    return min(ends), max(ends) + more  # nobody goes under the lowest: that is the floor


def _box(plan: GroundPlan, area: Area, starts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners (2,), (2,) of the grid where there is no map."""
    if plan.fences:
        lows, highs = zip(*(shape.bounds() for shape in plan.fences), strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)
    low = np.minimum(area.low[:2], starts[:2].min(axis=1))
    high = np.maximum(area.high[:2], starts[:2].max(axis=1))
    more = BEYOND * float((high - low).max()) + plan.radius
    return low - more, high + more


def _few_enough(cells: int) -> None:
    if cells > MAX_CELLS:
        raise ValueError(f"resolution_m: expected at most {MAX_CELLS:,} cells, found {cells:,}")


def _factor(plan: GroundPlan, ground: OccupancyMap) -> int:
    """How many cells of the map, along one side, make one of the ground."""
    if plan.resolution is None:
        return max(1, int(0.5 * plan.radius / ground.resolution + 1e-9))
    if plan.resolution < ground.resolution * (1 - 1e-9):
        raise ValueError(
            f"resolution_m: expected at least the map's {ground.resolution:g}, got {plan.resolution:g}"
        )
    return max(1, int(plan.resolution / ground.resolution + 1e-9))


def _coarse(blocked: BoolArray, factor: int) -> BoolArray:
    """Blocks of `factor` x `factor` cells, blocked where any of theirs is, or lies beyond the map."""
    rows, columns = (-(-n // factor) * factor for n in blocked.shape)
    whole = np.ones((rows, columns), dtype=np.bool_)
    whole[: blocked.shape[0], : blocked.shape[1]] = blocked
    blocks = whole.reshape(rows // factor, factor, columns // factor, factor)
    return np.asarray(blocks.any(axis=(1, 3)))


def _thick(blocked: BoolArray) -> BoolArray:
    """Grown by one cell in all eight directions."""
    out = blocked.copy()
    out[1:] |= blocked[:-1]
    out[:-1] |= blocked[1:]
    tall = out.copy()
    out[:, 1:] |= tall[:, :-1]
    out[:, :-1] |= tall[:, 1:]
    return out


def _middles(shape: tuple[int, ...], resolution: float, origin: FloatArray) -> FloatArray:
    """The middles (2, n) of a grid's cells, row by row."""
    u, v = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
    c, s = np.cos(origin[2]), np.sin(origin[2])
    x, y = resolution * u.ravel(), resolution * v.ravel()
    return np.stack([origin[0] + c * x - s * y, origin[1] + s * x + c * y])


def _fenced(fences: tuple[Shape, ...], points: FloatArray) -> FloatArray:
    """(n,) metres to the inside of the nearest fence, negative inside of one."""
    return np.asarray(np.min([shape.distances(points) for shape in fences], axis=0))


def _fence(cells: FlagArray, plan: GroundPlan, middles: FloatArray, resolution: float) -> None:
    """Keep a robot's radius inside the fences. Where fences overlap, their common outline is not looked for:
    a robot keeps the radius inside one of them."""
    if not plan.fences:
        return
    half = resolution * math.sqrt(0.5)
    gap = _fenced(plan.fences, middles).reshape(cells.shape[1:])
    cells[:, gap > -half] = SOLID
    for state, reach in ((TIGHT, plan.radius + plan.room), (MARGIN, plan.radius)):
        near = gap > -half - reach
        cells[:, near] = np.maximum(cells[:, near], state)


def _block(
    cells: FlagArray,
    shape: Shape,
    plan: GroundPlan,
    middles: FloatArray,
    resolution: float,
    altitudes: tuple[float, float],
) -> None:
    """Block the cells that a shape reaches into, and those nearer to it than the radius."""
    half = resolution * math.sqrt(0.5)
    low, high = shape.bounds()
    reach = plan.radius + plan.room + 2.0 * half
    near = np.flatnonzero(
        ((middles >= (low - reach)[:, None]) & (middles <= (high + reach)[:, None])).all(axis=0)
    )
    gap = np.maximum(shape.distances(np.ascontiguousarray(middles[:, near])) - half, 0.0)
    layers = len(cells)
    flat = cells.reshape(layers, -1)
    for k in range(layers):
        above = 0.0
        if layers > 1:
            height = (altitudes[1] - altitudes[0]) / layers
            floor = altitudes[0] + k * height
            above = max(shape.altitude[0] - (floor + height), floor - shape.altitude[1], 0.0)
        far = np.hypot(gap, above)
        state = np.where(far < plan.radius, MARGIN, np.where(far < plan.radius + plan.room, TIGHT, OPEN))
        state[far <= 0.0] = SOLID
        flat[k, near] = np.maximum(flat[k, near], state)
