"""The team's picture in Rerun: hears every message of the team, and draws what is new of it.

Messages only change what is remembered; `show` draws, so that any rate of messages costs the same. All
robots go into one call each for bodies, headings, trails and fields of view: one batch is several times
cheaper than one call per robot.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from agents.mission.mission import Mission, start_pose
from agents.swarm.shown import Shown
from agents.wire import messages as m
from agents.wire.transport import PeerChange
from bridges.rerun import blueprint as paths
from bridges.rerun import shapes
from bridges.rerun.output import Mode, RerunOutput
from bridges.rerun.plots import Latencies, Troubles
from bridges.rerun.scene import Scene
from estimator.arrays import FloatArray

Outline = Callable[[FloatArray], FloatArray]
"""A pose (4,) to the closed polyline (k, 3) of a field of view there."""

SLOW_S = 1.0  # team seconds between drawings of what changes slowly: trails and plans
_LATEST_S = 1e8  # no mission lasts three years: such a time is a defect of its sender
_STILL_M_S = 0.1
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class RerunView:
    """Draws one mission. Used by one thread; may wait for a slow viewer, so never in a control process.

    `outlines` gives each robot's field of view by its id; a robot without one is drawn without.
    """

    def __init__(
        self,
        mission: Mission,
        *,
        outlines: Mapping[str, Outline] | None = None,
        record: Path | None = None,
        mode: Mode = "none",
    ) -> None:
        self.mission = mission
        self.ignored = 0  # messages of another dimension or an impossible time
        self.output = RerunOutput(mission.name, paths.blueprint(mission), record=record, mode=mode)
        self._stream = self.output.stream
        self._scene = Scene(mission, self._stream)
        self._outlines = dict(outlines or {})
        self._colours = paths.colours(mission)
        self._poses = {robot.id: start_pose(robot) for robot in mission.robots}
        self._velocities = {robot.id: np.zeros(3) for robot in mission.robots}
        self._trails = {robot.id: shapes.Trail(0.004 * self._scene.size) for robot in mission.robots}
        self._states = {robot.id: "" for robot in mission.robots}
        self._drawn_states: dict[str, str] = {}
        self._gone: set[str] = set()
        self._plans: dict[str, m.PlanMessage] = {}
        self._shown = Shown(mission.fusion.alone_after_s)
        self._truth: m.TruthMessage | None = None
        self._latencies = Latencies()
        self._troubles = Troubles()
        self._new: set[type[m.Message]] = set()
        self._picture: m.PictureMessage | None = None
        self._newest = 0.0
        self._slow_at = -np.inf
        self._scene.draw_area()
        paths.log_styles(self._stream, mission)

    def __repr__(self) -> str:
        return f"RerunView({self.mission.name}, time={self._newest:.1f}, {self.output})"

    def on_message(self, topic_name: str, message: m.Message) -> None:
        """Take in a message of any topic, as the codec gives it."""
        if not abs(message.time) < _LATEST_S or not self._fits(message):
            self.ignored += 1
            return
        self._newest = max(self._newest, message.time)
        match message:
            case m.PoseMessage() if message.sender in self._poses:
                self._poses[message.sender] = message.pose
                self._velocities[message.sender] = message.velocity
                self._states[message.sender] = message.state
                self._trails[message.sender].add(self._scene.place(message.pose))
            case m.PlanMessage() if message.sender in self._poses:
                self._plans[message.sender] = message
            case m.EstimateMessage():
                self._shown.hear(message, self._newest)
                self._new.add(m.EstimateMessage)
            case m.PictureMessage():
                self._picture = message
            case m.TruthMessage():
                self._truth = message
            case m.HealthMessage():
                self._latencies.hear(message)
                self._troubles.hear(message)
            case m.EventMessage():
                self._draw_event(message)
        self._new.add(type(message))

    def on_peer(self, change: PeerChange) -> None:
        """A process came or went; a robot that is gone is drawn grey."""
        peer = change.peer
        if peer.role != "robot" or peer.id not in self._poses:
            return
        if change.alive:
            self._gone.discard(peer.id)
        else:
            self._gone.add(peer.id)
        self._new.add(m.PoseMessage)

    def show(self, now: float | None = None) -> None:
        """Draw all that is new, at team time `now`; None: the newest time in a message."""
        at = self._newest if now is None else now
        if not abs(at) < _LATEST_S or not self._new:
            return
        self._stream.set_time(paths.TIMELINE, duration=round(at, 2))
        new, self._new = self._new, set()
        slow = at >= self._slow_at + SLOW_S or at < self._slow_at
        if m.PoseMessage in new:
            self._draw_robots(slow)
        if slow:
            self._slow_at = at
            self._draw_plans(at)
        elif m.PlanMessage in new:
            self._new.add(m.PlanMessage)  # not forgotten: the next slow drawing shows it
        if m.PictureMessage in new and self._picture is not None:
            self._scene.draw_picture(self._picture)
        if m.EstimateMessage in new or m.TruthMessage in new:
            self._scene.draw_posterior(self._shown.estimate, self._truth, at)
        for path, values in (*self._latencies.due(at), *self._troubles.due(at)):
            self._stream.log(path, rr.Scalars(values))

    def close(self, timeout: float = 1.5) -> None:
        """Write the recording's end and close the viewer, within about `timeout` seconds."""
        self.output.close(timeout)

    def _fits(self, message: m.Message) -> bool:
        """Whether the arrays are of this mission's dimension: the codec knows only that they agree."""
        match message:
            case m.PosteriorMessage():
                return bool(message.means.shape[0] == self._scene.dimension == message.found.shape[0])
            case m.PictureMessage():
                dimensions = {message.points.shape[0], message.exploration.ndim}
                return dimensions == {self._scene.dimension} and message.exploration.size > 0
            case m.TruthMessage():
                return bool(message.targets.shape[0] == self._scene.dimension)
        return True

    def _heading(self, robot: str) -> FloatArray:
        """Where a robot goes, or where it looks when it stands still, as a unit vector (3,)."""
        velocity = self._velocities[robot].copy()
        if self._scene.dimension == 2:
            velocity[2] = 0.0
        speed = float(np.linalg.norm(velocity))
        yaw = self._poses[robot][3]
        return velocity / speed if speed > _STILL_M_S else np.array([np.cos(yaw), np.sin(yaw), 0.0])

    def _colour(self, robot: str) -> shapes.Colour:
        return (107, 114, 128, 255) if robot in self._gone else self._colours[robot]

    def _draw_robots(self, slow: bool) -> None:
        ids = list(self._poses)
        poses = np.array([self._poses[robot] for robot in ids])
        places = np.array([self._scene.place(pose) for pose in poses])
        colours = [self._colour(robot) for robot in ids]
        labels = [f"{robot} gone" if robot in self._gone else robot for robot in ids]
        log = self._stream.log
        log(paths.ROBOTS, rr.Points3D(places, radii=-5.5, colors=colours, point_shading=self._scene.shading))
        log(paths.NAMES, self._scene.names(places, labels, colours))
        vectors = 0.035 * self._scene.size * np.array([self._heading(robot) for robot in ids])
        log(paths.HEADINGS, rr.Arrows3D(vectors=vectors, origins=places, radii=-2.0, colors=colours))
        strips, faint = [], []
        for robot, pose in zip(ids, poses, strict=True):
            if robot in self._outlines and robot not in self._gone:
                strip = np.array(self._outlines[robot](pose), dtype=np.float64)
                if self._scene.dimension == 2:
                    strip[:, 2] = self._scene.layer(5)
                strips.append(strip)
                faint.append(shapes.faded(self._colour(robot), 150 if self._scene.dimension == 2 else 90))
        log(paths.VIEWS, rr.LineStrips3D(strips, radii=-0.8, colors=faint))
        if slow:
            dim = [shapes.faded(colour, 120) for colour in colours]
            trails = [self._trails[robot].strip(place) for robot, place in zip(ids, places, strict=True)]
            log(paths.TRAILS, rr.LineStrips3D(trails, radii=-0.9, colors=dim))
        heads = [
            np.array([*self._trails[robot].points[-12:], place])
            for robot, place in zip(ids, places, strict=True)
        ]
        log(paths.TRAIL_HEADS, rr.LineStrips3D(heads, radii=-1.5, colors=colours))
        for robot in ids:
            state = "gone" if robot in self._gone else self._states[robot]
            if state and state != self._drawn_states.get(robot):
                self._drawn_states[robot] = state
                log(f"{paths.STATES}/{robot}", rr.StateChange(state=state))

    def _draw_plans(self, now: float) -> None:
        strips, colours, measures, measure_colours, waypoints = [], [], [], [], []
        for robot, plan in self._plans.items():
            if plan.end_time <= now or robot in self._gone:
                continue
            colour = shapes.faded(self._colour(robot), 130)
            ahead = plan.poses[plan.times >= now]
            strips.append(np.array([self._scene.place(pose) for pose in (self._poses[robot], *ahead)]))
            colours.append(colour)
            for pose in plan.measure_poses[plan.measure_times >= now]:
                measures.append(self._scene.place(pose))
                measure_colours.append(self._colour(robot))
            waypoints.append(self._scene.place(plan.waypoint))
        log = self._stream.log
        log(paths.PLANS, rr.LineStrips3D(strips, radii=-0.7, colors=colours))
        log(paths.PLAN_MEASUREMENTS, rr.Points3D(measures, radii=-2.0, colors=measure_colours))
        rings = shapes.rings(np.array(waypoints).reshape(-1, 3), 0.012 * self._scene.size)
        log(paths.PLAN_WAYPOINTS, rr.LineStrips3D(rings, radii=-1.0, colors=colours))

    def _draw_event(self, message: m.EventMessage) -> None:
        self._stream.set_time(paths.TIMELINE, duration=round(message.time, 1))
        text = rr.TextLog(f"{message.sender}: {message.text}", level=_LEVELS.get(message.level, "INFO"))
        self._stream.log(f"{paths.EVENTS}/{message.sender}", text)
