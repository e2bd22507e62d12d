"""The robot process: one Robot with its body on the real clock and the real network."""

import asyncio
import gc
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from agents.devices import LiveSensor
from agents.errors import LinkError, MissionError, StorageError
from agents.health.health import health_message
from agents.ledger.snapshot import fingerprint
from agents.machine import (
    Action,
    Event,
    Heard,
    Publish,
    Reckon,
    Reckoned,
    Release,
    RequestPlan,
    Store,
)
from agents.mission.mission import Mission
from agents.mission.mission_file import mission_hash
from agents.process.piloting import Piloting
from agents.process.planning import PlanThread
from agents.process.rehearsal import rehearse_robot
from agents.process.shell import HEALTH_PERIOD_S, Shell, run_until_done
from agents.robot.body import RobotBody
from agents.robot.outbox import Outbox
from agents.robot.plan_request import RobotSetup
from agents.robot.robot import Robot
from agents.team import Team
from agents.wire.attention import Attention
from agents.wire.messages import MeasurementSetMessage, PoseMessage
from agents.wire.topics import (
    BELIEF,
    BID,
    EVENT,
    HEALTH,
    PICTURE,
    PLAN,
    POSE,
    POSTERIOR,
    REQUEST,
    SET,
    SOFT_OBSERVATION,
    STATE,
    Topic,
)
from planner.avoidance.halt import Evader
from planner.plan import TeamPlanner

# Robots; in a larger team a plan waits for the next step, which the robot's own poses cause, and others' sets
# are listened to only once no fusion is there: the robots' caches then give what the last minute brought.
FEW = 16
CROWD_STAGGER_S = 0.2  # from a robot's first plan to the next one's: fifty at once keep the fusion waiting


def run(mission: Mission, robot_id: str, *, outbox: Path, connect: Sequence[str] = ()) -> int:
    """Run one robot until it is told to end; the exit status. `outbox` keeps the sets that no fusion has.

    Raises:
        SearchpartyError: with what to do about it.
    """
    try:
        mission.robot(robot_id)
    except KeyError:
        known = ", ".join(robot.id for robot in mission.robots)
        raise MissionError(f"the mission has no robot {robot_id!r}; its robots are {known}") from None
    return run_until_done(partial(_main, mission, robot_id, outbox, connect))


async def _main(mission: Mission, robot_id: str, path: Path, connect: Sequence[str]) -> int:
    team = Team.of(mission)
    if isinstance(team.planner, TeamPlanner):
        raise MissionError(f"planner {mission.planner['kind']!r} needs a centre: use searchparty simulate")
    with Piloting(team, robot_id) as piloting:
        rehearse_robot(team, robot_id)
        piloting.prepare()
        gc.collect()
        gc.freeze()  # what lives now lives to the end: no collection needs to look at it
        async with Shell(mission, "robot", robot_id, connect) as shell:
            await _in_team(shell, team, robot_id, path, piloting)
    return 0


async def _in_team(shell: Shell, team: Team, robot_id: str, path: Path, piloting: Piloting) -> None:
    """From joining the team to leaving it."""
    mission = team.mission
    for topic in (POSE, PICTURE, POSTERIOR, STATE):
        shell.transport.subscribe(topic, urgent=False)
    if len(mission.robots) <= FEW:
        _listen_to_sets(shell)
    shell.transport.subscribe(PLAN, urgent=len(mission.robots) <= FEW)
    for topic in (POSE, SET, PLAN, HEALTH, EVENT, BELIEF):
        shell.transport.prepare(topic)
    try:
        seed = await shell.join_team()
    except LinkError:
        return
    with _outbox(shell, seed, path) as outbox:
        process = RobotProcess(shell, team, robot_id, seed, outbox, piloting)
        try:
            await process.run()
        finally:
            process.close()


def _outbox(shell: Shell, seed: int, path: Path) -> Outbox:
    """What the robot's earlier boots in this run left, told to people."""
    mission = shell.mission
    run = f"{shell.clock.epoch!r} {seed} {mission_hash(mission)}"
    outbox = Outbox(
        path, team=mission.team, robot=shell.name, run=run, synchronous=mission.fusion.synchronous
    )
    if outbox.left:
        shell.announce(f"offers {len(outbox.left)} sets that it had measured before it started again")
    if outbox.put_aside is not None:
        shell.announce(f"had sets of another run, which are now in {outbox.put_aside}", "warning")
    return outbox


def _listen_to_sets(shell: Shell) -> None:
    for topic in (SET, SOFT_OBSERVATION):
        shell.transport.subscribe(topic, urgent=False)


class RobotProcess:
    """The loop around one RobotBody."""

    def __init__(
        self, shell: Shell, team: Team, robot_id: str, seed: int, outbox: Outbox, piloting: Piloting
    ) -> None:
        self._shell = shell
        self._piloting = piloting
        self._outbox = outbox
        self._unkept = 0  # sets that the disk did not take
        self._estimating: ThreadPoolExecutor | None = None  # once the robot is on its own
        self._planning = PlanThread(team.planner, shell.tell, partial(shell.announce, level="error"))
        now = max(0.0, shell.clock.now())
        world = team.world(seed)
        piloting.begin(shell)
        vehicle = piloting.vehicle or team.vehicle(robot_id, seed, world, now=now, speed=shell.clock.speed)
        live = team.listen(robot_id, seed, world, now=now, speed=shell.clock.speed)
        sensor = live or team.sensor(robot_id, seed, world, now=now, speed=shell.clock.speed)
        desk = team.desk(robot_id) if vehicle.follows_plans else None
        if desk is not None:
            shell.transport.subscribe(BID)
            shell.transport.subscribe(REQUEST)
            shell.transport.prepare(BID)
        setup = RobotSetup(
            mission=team.mission,
            robot=robot_id,
            boot=shell.boot,
            vehicle=team.vehicle_models[robot_id],
            vehicles=team.vehicle_models,
            ground=team.ground,
            sensors=team.sensor_models,
            area=team.area,
            periods=team.measure_periods,
            follows_plans=vehicle.follows_plans,
            first_capture=None if isinstance(sensor, LiveSensor) else sensor.next_capture(now - 1e-9),
            plan_lead_s=0.25 * max(1.0, shell.clock.speed),
            stagger_s=0.1 if len(team.mission.robots) <= FEW else CROWD_STAGGER_S,
            speed=shell.clock.speed,
            patience=shell.clock.speed,
            desk=desk,
            left=outbox.left,
            alone=team.alone(seed, fingerprint(team.mission, seed, team.filter)),
        )
        self._robot = Robot(setup, now)
        self._robot.stamp = shell.stamp
        self._body = RobotBody(self._robot, vehicle, sensor, shell.clock, self._perform)
        self._attention = Attention(
            robot_id,
            {r: model.evasion.speed for r, model in team.vehicle_models.items() if isinstance(model, Evader)},
            team.mission.settings.separation_m,
        )
        shell.mailbox.wanted = self._wanted

    async def run(self) -> None:
        """Until the process is told to end."""
        shell = self._shell
        shell.announce(f"joined as boot {shell.boot}")
        while shell.clock.now() < 0.0 and not shell.stopping:
            await shell.sleep_until(0.0)
        shell.every(HEALTH_PERIOD_S, self._publish_health)
        while not shell.stopping:
            events = shell.events()
            self._piloting.hear(events)
            self._look_around(events)
            if "fusion" not in shell.roles_alive:
                _listen_to_sets(shell)
            self._body.step(events)
            await shell.sleep_until(self._body.next_wake())
        self._piloting.leave()
        self._publish_health()

    def _wanted(self, topic: Topic, sender: str) -> bool:
        return topic is not POSE or self._attention.wants(sender, self._shell.clock.now())

    def _look_around(self, events: Sequence[Event]) -> None:
        poses = [e.message for e in events if isinstance(e, Heard) and isinstance(e.message, PoseMessage)]
        if poses:
            now = self._shell.clock.now()
            mine = self._body.vehicle.state(now).pose
            for message in poses:
                self._attention.heard(message.sender, message.pose, mine, now)

    def close(self) -> None:
        """Let go of devices and the planner's thread."""
        self._piloting.finish()
        self._body.close()
        self._planning.close()
        if self._estimating is not None:
            self._estimating.shutdown(wait=False, cancel_futures=True)

    def _perform(self, action: Action) -> None:
        if isinstance(action, Publish):
            self._shell.publish(action.topic, action.message)
        elif isinstance(action, Store | Release):
            self._keep(action)
        elif isinstance(action, Reckon):
            self._reckon(action)
        elif isinstance(action, RequestPlan):
            self._planning.ask(action)

    def _keep(self, action: Store | Release) -> None:
        """A full disk does not stop a robot: it goes on, and says what it cannot promise any more."""
        try:
            if isinstance(action, Release):
                self._outbox.release(action.places)
            else:
                self._outbox.add([e for e in action.entries if isinstance(e, MeasurementSetMessage)])
        except StorageError as error:
            if not self._unkept:
                self._shell.announce(f"{error}; until then a restart would lose its newest sets", "error")
            self._unkept += 1

    def _reckon(self, action: Reckon) -> None:
        if self._estimating is None:
            self._estimating = ThreadPoolExecutor(1, thread_name_prefix="estimator")
        future = asyncio.get_running_loop().run_in_executor(self._estimating, action.work)
        future.add_done_callback(partial(self._reckoned, action.number))

    def _reckoned(self, number: int, future: "asyncio.Future[None]") -> None:
        if future.cancelled():
            return
        if (error := future.exception()) is not None:
            self._shell.announce(f"the own estimate failed: {error!r}; going on with it as it was", "error")
        self._shell.tell(Reckoned(number))

    def _publish_health(self) -> None:
        shell, robot, body = self._shell, self._robot, self._piloting.health()
        sensor = self._body.sensor
        if isinstance(sensor, LiveSensor):
            for level, text in sensor.news():
                shell.announce(text, level)
        message = health_message(
            shell.stamp,
            shell.clock.now(),
            "robot",
            robot.state,
            shell.mailbox,
            shell.transport.statistics(),
            {
                "sets": robot.stamp.sent(SET),
                "reoffered": robot.unacknowledged.reoffered,
                "unacknowledged": len(robot.unacknowledged),
                "unkept_sets": self._unkept,
                "skipped_measurements": robot.measuring.skipped,
                "untimed_measurements": robot.measuring.untimed,
                **(robot.allocation.counters() if robot.allocation else {}),
                **(body.counters if body else {}),
                **(sensor.counters() if isinstance(sensor, LiveSensor) else {}),
            },
            shell.gauges()
            | (robot.allocation.gauges() if robot.allocation else {})
            | (dict(body.gauges) if body else {}),
            {"measure_clock_lateness_ms": self._body.lateness_ms, "plan_ms": self._planning.took_ms},
            body.words if body else "",
        )
        shell.publish(HEALTH, message)
