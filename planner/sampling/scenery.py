"""What lasts from one plan of a robot to the next: its grid, footprints of its sensor, the ground."""

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.allocation.ability import cruise, sweep_width
from planner.plan import Over, PlannerSetup, PlanProblem, never
from planner.sampling.board import MOVES, Board, board, turn_table
from planner.sampling.grid import Grid
from planner.sampling.land import Land
from planner.sampling.sight import Footprints, Surveyed, depends_on_heading, in_the_open

MOST_CELLS = 10_000
MOST_ON_GROUND = 2_500  # steps between any two cells are kept
_COARSEST, _FINEST = 1.0, 0.4  # cell over the width that the sensor sweeps
_ALTITUDES_M = 0.5  # a robot that flies higher or lower than this sees something else
_MOVING_M_S = 0.2  # slower, a turn costs nothing


class Scenery:
    """One robot's grid and what its sensor observes from each cell."""

    def __init__(
        self,
        setup: PlannerSetup,
        problem: PlanProblem,
        cell_m: float | None,
        altitude: float,
        land: Land | None,
    ) -> None:
        self._setup, self._robot = setup, problem.robot
        self._vehicle, sensor = setup.vehicles[problem.robot], setup.sensors[problem.robot]
        area = setup.area
        self._altitude, self._period = altitude, problem.measure_period
        speed = cruise(self._vehicle, area)
        if cell_m is None:
            width = sweep_width(sensor, area, altitude)
            cell_m = float(np.clip(speed * self._period, _FINEST * width, _COARSEST * width))
        walls = area.map is not None
        limited = setup.ground is not None or walls
        self.grid = Grid.over(area, cell_m, MOST_ON_GROUND if limited else MOST_CELLS)
        self.step_s = float(self.grid.size.min()) / speed
        looks = float(np.clip(self.step_s / self._period, 0.05, 20.0))
        self._headings = 8 if depends_on_heading(sensor, self.grid, altitude) else 1
        self._footprints: Footprints | None = None
        self._surveyed: Surveyed | None = None
        if walls:
            self._surveyed = Surveyed(sensor, self.grid, altitude, looks, self._headings)
        else:
            self._footprints = in_the_open(sensor, self.grid, altitude, looks, self._headings)
        self.land = land
        if setup.ground is not None and land is None:
            self.land = Land(setup.ground, self.grid)

    def __repr__(self) -> str:
        return f"Scenery({self._robot}, {self.grid.shape}, {self.step_s:.2f} s a step)"

    def holds_for(self, problem: PlanProblem, altitude: float) -> bool:
        """Whether nothing has changed on which it depends."""
        high = self._setup.area.dimension == 2 and abs(altitude - self._altitude) > _ALTITUDES_M
        return not high and problem.measure_period == self._period

    def known(self, over: Over) -> bool:
        """Whether the ground and what is seen from everywhere are known; False if time is over first.

        What has been found out by then need not be found out again.
        """
        if self._surveyed is not None:
            self._footprints = self._surveyed.rows(over)
        return self._footprints is not None and (self.land is None or self.land.ready(over))

    def board(self, values: FloatArray, problem: PlanProblem, turn_deg: float | None) -> Board:
        """The board for unobserved targets `values` (n,), once all is `known`."""
        velocity = self._vehicle.velocity(problem.state)
        heading = -1
        if turn_deg is not None and np.linalg.norm(velocity) > _MOVING_M_S:
            unit = MOVES / np.linalg.norm(MOVES, axis=1, keepdims=True)
            heading = int(np.argmax(unit @ velocity))
        return board(
            self.grid.shape,
            values,
            footprints=self._footprints,
            headings=self._headings,
            open_moves=None if self.land is None else self.land.moves,
            hops=None if self.land is None else self.land.hops,
            turns=None if turn_deg is None else turn_table(turn_deg),
            heading=heading,
        )

    def start(self, pose: FloatArray) -> int | None:
        """The cell from which a path begins; None if no cell is open."""
        place = np.array(pose[: len(self.grid.shape)])
        if self.land is None:
            return int(self.grid.cells_of(place[:, None])[0])
        return self.land.nearest(place)

    def route(self, pose: FloatArray, cells: IntArray, over: Over = never) -> FloatArray | None:
        """(r, 3) the corners of the way along cells; None if the ground has no way to its beginning."""
        d = len(self.grid.shape)
        corners = self._corners(cells)
        ground = self._setup.ground
        if ground is not None:
            here = np.array(pose[:d])
            if not ground.segments_clear(here[:, None], corners[:, :1])[0]:
                corners = np.hstack([self.grid.centres(cells[:1]), corners])
            if not ground.segments_clear(here[:, None], np.ascontiguousarray(corners[:, :1]))[0]:
                around = ground.path(here, np.array(corners[:, 0]), over)
                if around is None:
                    return None
                corners = np.hstack([around[:, 1:-1], corners])
        route = np.full((corners.shape[1], 3), float(pose[2]))
        route[:, :d] = corners.T
        return route

    def _corners(self, cells: IntArray) -> FloatArray:
        """(d, c) centres of the cells at which a path turns, and of its last."""
        strides = np.diff(cells)
        last = np.append(strides[1:] != strides[:-1], True)
        return self.grid.centres(cells[1:][last])
