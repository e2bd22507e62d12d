"""The mission: one TOML file that says who searches where for what, and how.

These are its tables. Tables whose `kind` names a plugin (world, filter, planner, vehicle, sensor, link) are
kept as plain dictionaries here and checked against the plugin's own `Config` by
`agents.mission.mission_file`.
"""

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from agents.mission.ground_tables import GroundTable, OriginTable
from agents.mission.tables import resolve_path
from agents.wire.messages import Name, Relation, Slope
from estimator.arrays import Count, FloatArray, NonNegative, Positive
from estimator.filter import Area

Table = dict[str, Any]
TASK_KINDS = ("explore", "refine", "request")  # what robots that share tasks may be able to do
Vector = Annotated[list[float], Meta(min_length=2, max_length=3)]


class Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class AreaTable(Strict, frozen=True, kw_only=True):
    """The box in which targets may be, metres east, north (and up)."""

    min: Vector
    max: Vector


class MapTable(Strict, frozen=True, kw_only=True):
    """What is known of walls."""

    kind: str = "ros"  # reader, from the entry points searchparty.maps
    file: Annotated[str, Meta(min_length=1)]
    line_of_sight: bool = True  # sensors do not see through walls
    unknown: Literal["clear", "blocks"] = "clear"  # whether sight goes through unknown cells


class FoundTable(Strict, frozen=True, kw_only=True):
    """When a cluster counts as a found target, (MA)ASI section 3.3."""

    radius_m: Positive = 1.1  # T_r
    mass: Positive = 0.8  # T_m
    gate_m: Positive = 5.0  # T_z
    same_sigmas: NonNegative = 0.0  # a cluster this near to a found target is that target; 0: never
    period_s: NonNegative = 0.0  # clusters are looked for at most this often; 0: after every set
    blur_m: NonNegative = 0.0  # measurements of a found target are off by this beyond the sensor's noise
    remove: bool = True  # found targets leave the intensity; false: they stay and are followed, as they move


class TeammatesTable(Strict, frozen=True, kw_only=True):
    """What the robots' sensors see of each other."""

    rate: NonNegative = 0.0  # measurements of a robot in view per set; 0: sensors do not see robots
    spread_m: Positive = 0.1  # standard deviation of where a robot is seen around its pose


class ExplorationTable(Strict, frozen=True, kw_only=True):
    """The grid of the exploration function, (MA)ASI (20)."""

    points: Annotated[list[Count], Meta(min_length=2, max_length=3)] = msgspec.field(
        default_factory=lambda: [27, 27]
    )


class TriggerTable(Strict, frozen=True, kw_only=True):
    """Event-triggered measurements, (MA)ASI (24), (33)."""

    enabled: bool = False
    gamma: NonNegative = 1.0
    threshold: NonNegative = 4.0  # T_delta


class FusionTable(Strict, frozen=True, kw_only=True):
    """How the fusion treats time and disk, how many there are, and what robots do without one."""

    rollback_s: NonNegative = 5.0  # sets at most this late are put in their place at once
    late_sets: Literal["apply", "expire"] = "apply"  # beyond it: in their place too, or count as expired
    picture_period_s: Positive = 1.0
    replicas: Annotated[int, Meta(ge=1, le=8)] = 1  # fusions: fusion, fusion-2, ...
    synchronous: Literal["normal", "full"] = "normal"  # stored sets survive a process's death, or a power cut
    share_state_s: NonNegative = 10.0  # robots are given the whole state this often; 0: never
    alone_after_s: Positive = 5.0  # a robot that hears no posterior for this long goes on alone


class LinkTable(Strict, frozen=True, kw_only=True):
    """The team's network."""

    kind: str = "zenoh"
    topology: Literal["star", "mesh", "router"] = "star"
    endpoints: list[str] = []  # mesh: rendezvous to listen on and connect to; router: where the router is
    keys: str = ""  # directory of the team's keys: TLS, each under its own name only; "": open
    lease_s: Positive = 2.0


class TeamTable(Strict, frozen=True, kw_only=True):
    """What holds for all robots."""

    separation_m: NonNegative = 0.0
    pose_period_s: Positive = 0.2
    reoffer_after_s: Positive = 2.0  # sets that no watermark covers after this are sent again
    start_timeout_s: Positive = 30.0  # the fusion waits this long (wall) for all robots before it starts


class ClockTable(Strict, frozen=True, kw_only=True):
    """How processes keep to the fusion's clock, which is the team's."""

    correct_up_to_s: Positive = 10.0  # a clock further off than this (wall) is refused, not corrected
    ask_every_s: Positive = 1.0  # a process asks the fusion for the time this often (wall)
    drift_ppm: NonNegative = 200.0  # two clocks run apart by at most this many microseconds in a second


class RestartTable(Strict, frozen=True, kw_only=True):
    """What `swarm` does when a process dies."""

    robot: Literal["never", "always"] = "never"
    fusion: Literal["never", "always"] = "always"


class BudgetTable(Strict, frozen=True, kw_only=True):
    """What a robot may spend in a mission."""

    distance_m: Positive | None = None  # metres travelled
    energy_wh: Positive | None = None  # of its battery, by the vehicle's `power`
    time_s: Positive | None = None  # team time from the mission's start
    return_home: bool = True  # it must be back where it started by then


class RobotTable(Strict, frozen=True, kw_only=True):
    """One robot."""

    id: Name
    start: Annotated[list[float], Meta(min_length=2, max_length=4)]  # x, y(, z(, yaw)); metres, radians
    vehicle: Table
    sensor: Table
    budget: BudgetTable | None = None
    capabilities: list[Name] = msgspec.field(default_factory=lambda: [*TASK_KINDS])  # and what requests need


class StatementTable(Strict, frozen=True, kw_only=True):
    """What an operator says in a simulated run."""

    at_s: NonNegative  # team time
    relation: Relation
    at: Annotated[list[Annotated[list[float], Meta(min_length=2, max_length=2)]], Meta(min_length=1)]
    yaw_deg: float = 0.0  # where the front is, of one place; counter-clockwise from east
    radius_m: Positive = 10.0  # "near" reaches this far
    outer_m: Positive | None = None  # "around" begins there and reaches this far; default: twice radius_m
    reach_m: Positive | None = None  # of a side: what is further away is neither in front nor behind
    slope: Slope = 1.0  # 1/m, of the log-odds across a border: 4.4 / slope metres from 10 to 90 %
    positive: bool = True  # false: nothing is there, or the target is not
    target: Annotated[str, Meta(max_length=64)] = ""  # its name; left out: something, or nothing


class RequestTable(Strict, frozen=True, kw_only=True):
    """A place that an operator asks the robots to look at, in a simulated run."""

    at_s: NonNegative  # team time
    name: Annotated[str, Meta(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9_.-]+$")]
    at: Vector  # metres, as many numbers as the area has axes
    worth: NonNegative = 1.0  # how much it matters, in targets to be found; 0 withdraws the request
    robots: Annotated[int, Meta(ge=1, le=64)] = 1  # that must look
    needs: list[Name] = []  # capabilities that they must have, beside request


class Mission(Strict, frozen=True, kw_only=True):
    """The whole file."""

    name: Name
    team: Name = "searchparty"
    description: str = ""
    directory: str = ""  # where relative paths begin; left out: the mission file's own directory
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    duration_s: Positive = 300.0
    stop_when_all_found: bool = True
    match_m: Positive = 2.0  # a found target this near to a true one counts as it
    gospa_c_m: Positive = 10.0  # cut-off c of the GOSPA metric (p = 2)
    area: AreaTable
    origin: OriginTable | None = None
    map: MapTable | None = None
    ground: GroundTable | None = None
    world: Table
    filter: Table
    found: FoundTable = FoundTable()
    teammates: TeammatesTable = TeammatesTable()
    exploration: ExplorationTable = ExplorationTable()
    planner: Table
    trigger: TriggerTable = TriggerTable()
    fusion: FusionTable = FusionTable()
    link: LinkTable = LinkTable()
    settings: TeamTable = TeamTable()
    clock: ClockTable = ClockTable()
    restart: RestartTable = RestartTable()
    robots: Annotated[list[RobotTable], Meta(min_length=1)]
    statements: list[StatementTable] = []
    requests: list[RequestTable] = []

    def box(self) -> Area:
        """The area as arrays."""
        return Area(np.array(self.area.min, dtype=np.float64), np.array(self.area.max, dtype=np.float64))

    def fusions(self) -> list[str]:
        """The names of the fusions, the first of which starts the team."""
        return ["fusion", *(f"fusion-{i}" for i in range(2, self.fusion.replicas + 1))]

    def robot(self, robot_id: str) -> RobotTable:
        """The robot of this id.

        Raises:
            KeyError: if there is none.
        """
        for robot in self.robots:
            if robot.id == robot_id:
                return robot
        raise KeyError(robot_id)


def link_of(mission: Mission) -> LinkTable:
    """A mission's link, with the path of its keys as it is on this computer."""
    link = mission.link
    if not link.keys:
        return link
    return msgspec.structs.replace(link, keys=str(resolve_path(mission.directory or None, link.keys)))


def start_pose(robot: RobotTable) -> FloatArray:
    """A robot's start as a full pose (4,); what the file leaves out is 0."""
    pose = np.zeros(4)
    pose[: len(robot.start)] = robot.start
    return pose
