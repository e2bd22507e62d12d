"""A robot with its body: carries out what concerns vehicle and sensor, hands on the rest. In both drivers."""

from collections.abc import Callable, Sequence

from agents.clock import Clock
from agents.devices import LiveSensor, Sensor, Vehicle
from agents.health.histogram import Histogram
from agents.machine import Action, Delayed, Event, Follow, Heard, Measure, Measured
from agents.mission.mission import start_pose
from agents.robot.pose_history import PoseHistory
from agents.robot.robot import Robot
from agents.robot.separation import Separation
from agents.wire.messages import PoseMessage
from agents.wire.presence import Presence
from agents.wire.transport import PeerChange


class RobotBody:
    """Steps a Robot until it has nothing more to measure; other actions go to `perform`."""

    def __init__(
        self,
        robot: Robot,
        vehicle: Vehicle,
        sensor: Sensor | LiveSensor,
        clock: Clock,
        perform: Callable[[Action], None],
    ) -> None:
        self.robot = robot
        self.vehicle = vehicle
        self.sensor = sensor
        self.lateness_ms = Histogram()
        self._poses = PoseHistory()
        self._clock = clock
        self._perform = perform
        self._presence = Presence("robot")
        setup = robot.setup
        self.separation = Separation(
            robot.id,
            setup.vehicles or {robot.id: setup.vehicle},
            setup.mission.settings.separation_m if vehicle.follows_plans else 0.0,
            level=setup.mission.box().dimension == 2,
            start=vehicle.state(clock.now()).pose[:3],
            ground=setup.ground,
            starts={one.id: start_pose(one)[:3].tolist() for one in setup.mission.robots},
        )

    def __repr__(self) -> str:
        return f"RobotBody({self.robot!r}, {self.vehicle!r})"

    def step(self, events: Sequence[Event]) -> None:
        """One step at the clock's time, and those that its measurements and the others' nearness cause."""
        now = self._clock.now()
        for event in events:
            if isinstance(event, Heard) and isinstance(event.message, PoseMessage):
                self.separation.hear(event.message, now)
            elif isinstance(event, PeerChange):
                came = self._presence.take(event)
                if came:
                    self.separation.expect(event.peer.id)
                elif came is False:
                    self.separation.gone(event.peer.id)
        if events or now >= self.robot.next_wake():
            self._decide(events)
        if self.separation.keep(now, self.vehicle):
            self._decide([Delayed()])

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        return min(self.robot.next_wake(), self.separation.next_wake)

    def _decide(self, events: Sequence[Event]) -> None:
        while True:
            now = self._clock.now()
            measured: list[Event] = []
            body = self.vehicle.state(now)
            self._poses.add(body.time, body.pose)
            for action in self.robot.step(now, body, events):
                if isinstance(action, Follow):
                    self.vehicle.follow(action.trajectory, now)
                    self.separation.follow(action.trajectory, body.pose[:3])
                elif isinstance(action, Measure):
                    measured += self._measure(action)
                else:
                    self._perform(action)
            if not measured:
                return
            events = measured

    def _measure(self, action: Measure) -> list[Measured]:
        now, sensor = self._clock.now(), self.sensor
        self.lateness_ms.add((now - action.deadline) / self._clock.speed * 1e3)
        if isinstance(
            sensor, LiveSensor
        ):  # what came since it was last asked; that nothing came says nothing
            seen = sensor.arrived(now, self._poses.at)
            return [Measured(each.time, each.pose, each.measurements, None) for each in seen]
        # A device with its own times measured at the deadline; any other measures now.
        own = sensor.next_capture(action.deadline)
        capture = now if own is None else action.deadline
        pose = self.vehicle.state(capture).pose
        return [Measured(capture, pose, sensor.measure(capture, pose), own)]

    def close(self) -> None:
        """Let go of the devices."""
        self.vehicle.close()
        self.sensor.close()
