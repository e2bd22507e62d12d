"""A made-up run, message by message, for tests of the view: robots sweep an area and find what they pass."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from agents.health.histogram import Histogram
from agents.mission.mission import AreaTable, ExplorationTable, Mission, RobotTable, start_pose
from agents.wire import messages as m
from estimator.arrays import FloatArray

REACH = 0.12  # of the area's side: how far a robot of the story sees


def mission(dimension: int, robots: int = 4, side: float = 200.0) -> Mission:
    """A mission of this many robots, which start in the area's corners."""
    corners = [[0.03, 0.03], [0.97, 0.03], [0.97, 0.97], [0.03, 0.97]]
    device = {"kind": "none"}
    starts = [
        [side * x, side * y, 0.1 * side * (i + 1 if dimension == 3 else 0.5)]
        for i in range(robots)
        for x, y in [corners[i % 4]]
    ]
    return Mission(
        name=f"story-{dimension}d",
        description=f"{robots} robots look for {10} targets in {side:g} m",
        area=AreaTable(min=[0.0] * dimension, max=[side] * dimension),
        exploration=ExplorationTable(points=[21] * dimension),
        world=device,
        filter=device,
        planner=device,
        robots=[
            RobotTable(id=f"r{i + 1}", start=start, vehicle=device, sensor=device)
            for i, start in enumerate(starts)
        ],
    )


def outline(reach: float, dimension: int) -> "Outline":
    return Outline(reach, dimension)


@dataclass(frozen=True)
class Outline:
    """A sector on the ground, or three circles around the robot in space."""

    reach: float
    dimension: int

    def __call__(self, pose: FloatArray) -> FloatArray:
        turn = np.linspace(0.0, 2.0 * np.pi, 33)
        flat = self.reach * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(33)])
        if self.dimension == 2:
            return np.asarray(flat + np.array([pose[0], pose[1], 0.0]))
        return np.asarray(np.vstack([flat, flat[:, [0, 2, 1]], flat[:, [2, 0, 1]]]) + pose[:3])


@dataclass
class Story:
    """Yields (topic name, message) in the order of time."""

    mission: Mission
    seed: int = 3
    duration: float = 120.0
    targets: FloatArray = field(init=False)
    _sequence: int = 0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.area = self.mission.box()
        self.size = self.area.high - self.area.low
        share = self.rng.uniform(0.08, 0.92, (self.area.dimension, 10))
        self.targets = self.area.low[:, None] + self.size[:, None] * share

    def _header(self, sender: str, time: float) -> dict[str, object]:
        self._sequence += 1
        return {
            "team": self.mission.team,
            "sender": sender,
            "boot": "b1",
            "sequence": self._sequence,
            "time": time,
        }

    def messages(self) -> Iterator[tuple[str, m.Message]]:
        dimension = self.area.dimension
        reach = REACH * float(self.size.max())
        poses = [start_pose(robot) for robot in self.mission.robots]
        waypoints = [self._waypoint() for _ in poses]
        travelled = np.zeros(len(poses))
        shape = tuple(self.mission.exploration.points)
        low, high = self.area.low, self.area.high
        axes = [np.linspace(low[i], high[i], n) for i, n in enumerate(shape)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        unexplored = np.ones(shape)
        seen = np.zeros(10)
        found: list[tuple[int, float]] = []
        spread = self.area.low[:, None] + self.size[:, None] * self.rng.random((dimension, 1500))
        histogram = Histogram()
        yield "event", m.EventMessage(**self._header("fusion", 0.0), level="info", text="all robots are here")
        for step in range(int(self.duration / 0.2)):
            time = 0.2 * step
            for i, robot in enumerate(self.mission.robots):
                gap = waypoints[i] - poses[i][:3]
                distance = float(np.linalg.norm(gap))
                if distance < 2.0 or step == 0:
                    waypoints[i] = self._waypoint()
                    yield "plan", self._plan(robot.id, poses[i], waypoints[i], time)
                    continue
                move = min(distance, 0.008 * float(self.size.max()))
                poses[i][:3] += move * gap / distance
                poses[i][3] = np.arctan2(gap[1], gap[0])
                travelled[i] += move
                yield (
                    "pose",
                    m.PoseMessage(
                        **self._header(robot.id, time),
                        pose=poses[i].copy(),
                        velocity=np.zeros(3),
                        state="moving" if time % 30 > 2 else "planning",
                        travelled=float(travelled[i]),
                    ),
                )
            if step % 5:
                continue
            known = [i for i, _ in found]
            for pose in poses:
                place = pose[:dimension]
                unexplored *= 1.0 - 0.9 * np.exp(-((np.linalg.norm(grid - place, axis=-1) / reach) ** 4))
                near = np.linalg.norm(self.targets.T - place, axis=1) < reach
                seen += near
                spread = spread[:, np.linalg.norm(spread.T - place, axis=1) > reach]
                histogram.add(float(self.rng.lognormal(0.5, 0.7)))
            for i in np.flatnonzero(seen > 6):
                if i not in known:
                    found.append((int(i), time))
                    text = f"target {len(found)} found"
                    yield "event", m.EventMessage(**self._header("fusion", time), level="info", text=text)
            known = [i for i, _ in found]
            open_ = [i for i in range(10) if seen[i] > 0 and i not in known]
            yield "posterior", self._posterior(time, step, open_, found, seen, spread.shape[1])
            sigma = 0.06 * float(self.size.max()) / np.sqrt(1.0 + seen[open_])
            clouds = [
                self.targets[:, [i]] + s * self.rng.standard_normal((dimension, 60))
                for i, s in zip(open_, sigma, strict=True)
            ]
            points = np.hstack([spread[:, ::3], *clouds])
            weights = np.r_[np.full(spread[:, ::3].shape[1], 0.004), np.full(60 * len(open_), 1 / 60)]
            yield (
                "picture",
                m.PictureMessage(
                    **self._header("fusion", time),
                    exploration=(255 * unexplored).astype(np.uint8),
                    points=points.astype(np.float32),
                    weights=weights.astype(np.float32),
                ),
            )
            yield "truth", m.TruthMessage(**self._header("sim", time), targets=self.targets)
            yield "health", self._health(time, histogram)

    def _waypoint(self) -> FloatArray:
        share = self.rng.uniform(0.1, 0.9, 3)
        low, size = np.zeros(3), np.zeros(3)
        low[: self.area.dimension], size[: self.area.dimension] = self.area.low, self.size
        if self.area.dimension == 2:
            low[2] = 10.0
        return low + size * share

    def _plan(self, robot: str, pose: FloatArray, waypoint: FloatArray, time: float) -> m.PlanMessage:
        distance = float(np.linalg.norm(waypoint - pose[:3]))
        duration = distance / (0.04 * float(self.size.max()))
        share = np.linspace(0.0, 1.0, 30)
        way = np.tile(pose, (30, 1))
        way[:, :3] += share[:, None] * (waypoint - pose[:3])
        instants = np.arange(0, 30, 6)
        return m.PlanMessage(
            **self._header(robot, time),
            plan_version=self._sequence,
            waypoint=waypoint,
            start_time=time,
            end_time=time + duration,
            measure_times=time + duration * share[instants],
            measure_poses=way[instants],
            times=time + duration * share,
            poses=way,
            conditioned_on={},
            objective=1.0,
            reason="",
        )

    def _posterior(
        self,
        time: float,
        step: int,
        open_: list[int],
        found: list[tuple[int, float]],
        seen: FloatArray,
        unexplored: int,
    ) -> m.PosteriorMessage:
        d, c = self.area.dimension, len(open_)
        sigma = 0.06 * float(self.size.max()) / np.sqrt(1.0 + seen[open_])
        stretch = np.diag(np.linspace(1.0, 0.4, d))
        return m.PosteriorMessage(
            **self._header("fusion", time),
            watermark={f"{r.id}/b1": m.Watermark(upto=step // 5) for r in self.mission.robots},
            applied=step // 5 * len(self.mission.robots),
            expected_cardinality=len(found) + c + 5.0 * unexplored / 1500,
            means=self.targets[:, open_],
            covariances=sigma[:, None, None] ** 2 * stretch[None],
            masses=np.ones(c),
            radii=sigma,
            velocities=np.zeros((d, c)),
            found=self.targets[:, [i for i, _ in found]],
            found_covariances=np.tile(np.eye(d), (len(found), 1, 1)),
            found_velocities=np.zeros((d, len(found))),
            found_times=np.array([t for _, t in found]),
            found_labels=np.arange(len(found)),
        )

    def _health(self, time: float, histogram: Histogram) -> m.HealthMessage:
        return m.HealthMessage(
            **self._header("fusion", time),
            role="fusion",
            state="running",
            counters={"published": self._sequence},
            gauges={},
            histograms={
                "capture_to_posterior_ms": histogram.counts.copy(),
                "measure_clock_lateness_ms": np.roll(histogram.counts, -20),
            },
        )
