"""What travels between the processes of a team.

Every message carries the schema version, team, sender, boot id (new at each start of a process), sequence
number (per sender, boot and topic) and capture time in team time. Arrays have fixed shapes, checked on
receipt by `codec.decode`; d is the dimension of the target space.
"""

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

Array = np.ndarray[Any, np.dtype[Any]]

SCHEMA_VERSION = 1

Name = Annotated[str, Meta(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]
Text = Annotated[str, Meta(max_length=2000)]
Sequence = Annotated[int, Meta(ge=0, le=2**53)]


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The header that all messages share."""

    version: int = SCHEMA_VERSION
    team: Name
    sender: Name
    boot: Name
    sequence: Sequence
    time: float  # capture time, team seconds


class StartMessage(Message, frozen=True, kw_only=True):
    """From the fusion, about once a second: when the team started, so that anyone can join."""

    epoch: float  # Unix seconds of team time 0
    speed: Annotated[float, Meta(gt=0, le=1e4)]
    seed: int
    mission_hash: Annotated[str, Meta(max_length=64)]
    answers: dict[str, Array] = {}  # "asker/boot" -> (2,): what it showed, and team time when that came


class ClockMessage(Message, frozen=True, kw_only=True):
    """A process asks the fusion what time it is; the start message answers."""

    shown: float  # the asker's own clock, uncorrected, team seconds


class PoseMessage(Message, frozen=True, kw_only=True):
    """Where a robot is and what it is doing."""

    pose: Array  # (4,)
    velocity: Array  # (3,)
    state: Annotated[str, Meta(max_length=32)]
    travelled: float  # metres since the start of the process


class MeasurementSetMessage(Message, frozen=True, kw_only=True):
    """All measurements of one sensor at one instant, also when there are none."""

    pose: Array  # (4,) of the robot at the capture time
    measurements: Array  # (m, s)


Relation = Literal["near", "around", "far", "inside", "outside", "in_front", "behind", "left", "right"]
Slope = Annotated[float, Meta(gt=0, le=1000)]  # 1/m, of the log-odds across a border


class SoftObservationMessage(Message, frozen=True, kw_only=True):
    """What an operator says of a place: "something (nothing, cone 3) is near it". Holds the place itself."""

    relation: Relation
    points: Array  # (p, 2) m: one place; or the corners of a region; or the two ends of a segment
    yaw: float  # rad, of a place that has a front; else 0
    inner: float  # m: "near" reaches this far; 0 where the relation is no distance
    outer: float  # m: "around" reaches this far; for sides: further away is elsewhere, 0: never
    slope: Slope
    positive: bool  # false: nothing, or not the target, is there
    target: Annotated[str, Meta(max_length=64)]  # its name; "": something, or nothing


LedgerEntry = MeasurementSetMessage | SoftObservationMessage  # what the fusion keeps and applies


class PlanMessage(Message, frozen=True, kw_only=True):
    """A committed trajectory, and the plans of others that it took into account."""

    plan_version: Sequence
    waypoint: Array  # (3,)
    start_time: float
    end_time: float
    measure_times: Array  # (m,)
    measure_poses: Array  # (m, 4)
    times: Array  # (k,)
    poses: Array  # (k, 4)
    conditioned_on: dict[str, int]  # robot -> plan_version
    objective: float
    reason: Text
    task: Annotated[str, Meta(max_length=80)] = ""  # that the plan is for, where robots share tasks


class Watermark(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What of one robot's or operator's boot is durable and applied: 0..upto, and the ranges beyond it."""

    upto: Annotated[int, Meta(ge=-1, le=2**53)]
    beyond: list[tuple[Sequence, Sequence]] = []  # first and last of each, growing


class EstimateMessage(Message, frozen=True, kw_only=True):
    """An estimate after some measurement sets. `time` is of the newest applied one."""

    applied: Sequence  # measurement sets in it
    expected_cardinality: float  # mass of the intensity plus the found targets that left it
    means: Array  # (d, c) clusters
    covariances: Array  # (c, d, d)
    masses: Array  # (c,)
    radii: Array  # (c,)
    velocities: Array  # (d, c) m/s, 0 where the filter estimates none
    found: Array  # (d, f) found targets
    found_covariances: Array  # (f, d, d)
    found_velocities: Array  # (d, f) m/s, 0 where the filter estimates none
    found_times: Array  # (f,)
    found_labels: Array  # (f,) int64, whole numbers that last over time


class PosteriorMessage(EstimateMessage, frozen=True, kw_only=True):
    """A fusion's estimate, after everything the watermark covers but what expired."""

    watermark: dict[str, Watermark]  # "robot/boot" or "operator/boot" ->
    expired: Sequence = 0  # measurement sets that came too late to be applied


class BeliefMessage(EstimateMessage, frozen=True, kw_only=True):
    """The estimate of a robot that hears no fusion, of the sets it knows. For people; nobody fuses it."""


class StateMessage(Message, frozen=True, kw_only=True):
    """A fusion's whole state, so that a robot can go on from it when it hears no fusion any more."""

    watermark: dict[str, Watermark]  # of all that is in it or expired, every boot and range
    applied: Sequence  # measurement sets in it
    state: bytes  # see agents.ledger.snapshot


class LedgerMessage(Message, frozen=True, kw_only=True):
    """From fusion to fusion: what a part of the ledger holds, so that the others can send what it lacks."""

    first: Annotated[str, Meta(max_length=200)]  # of the sources "sender/boot" that are told of
    last: Annotated[str, Meta(max_length=200)]  # and "" for no end
    holds: dict[str, Watermark]
    expired: dict[str, Watermark]


class Relayed(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One entry of a ledger, as its sender sent it."""

    topic: Name
    sender: Name
    payload: bytes


class RelayMessage(Message, frozen=True, kw_only=True):
    """From fusion to fusion: entries that another lacks."""

    entries: list[Relayed]


class PictureMessage(Message, frozen=True, kw_only=True):
    """The slow, large part of the posterior: exploration function and thinned intensity."""

    exploration: Array  # (g1, ..., gd) uint8, 255 = unexplored
    points: Array  # (d, k) float32
    weights: Array  # (k,) float32


Slot = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_.#-]+$")]  # a task, or part


class Wish(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An operator's request as robots pass it on to each other."""

    name: Name
    place: Annotated[list[float], Meta(min_length=2, max_length=3)]
    worth: float  # expected targets; 0: the request is withdrawn
    robots: Annotated[int, Meta(ge=1, le=64)]  # that must look
    needs: Annotated[list[Name], Meta(max_length=16)]
    asked: float  # team time; of two requests of one name the newer holds
    looked: Annotated[list[Name], Meta(max_length=1000)] = []  # robots that have looked there since


class RequestMessage(Message, frozen=True, kw_only=True):
    """From an operator, again and again until a robot passes it on."""

    wish: Wish


class BidMessage(Message, frozen=True, kw_only=True):
    """A robot's word on who does what, as in CBBA (y, z and s), and the tasks that it knows of."""

    said: float  # on the sender's own clock, which never goes back: what s of it is compared with
    tasks: Annotated[list[Name], Meta(max_length=512)]  # by name, t in all
    places: Array  # (t, d) where they are
    path: Annotated[list[Name], Meta(max_length=512)]  # the sender's own tasks in the order of execution
    winning_bids: dict[Slot, float]  # y, by task or, where one needs several robots, by part: "door#1"
    winning_agents: dict[Slot, Name]  # z
    timestamps: dict[Name, float]  # s: when each robot said what is known of it, on its own clock
    digests: dict[Name, int]  # of y and z, as each robot last believed
    wishes: Annotated[list[Wish], Meta(max_length=256)] = []


class HealthMessage(Message, frozen=True, kw_only=True):
    """How a process is. Counters only grow; histograms are those of `agents.health.histogram`."""

    role: Annotated[str, Meta(max_length=32)]
    state: Annotated[str, Meta(max_length=32)]
    counters: dict[str, int]
    gauges: dict[str, float]
    histograms: dict[str, Array]
    vehicle: Annotated[str, Meta(max_length=200)] = ""  # a real one in words: mode, battery, fix, link


class ResumeMessage(Message, frozen=True, kw_only=True):
    """From an operator: a robot may fly its real vehicle again, that somebody took over or that came down."""

    robot: Name


class EventMessage(Message, frozen=True, kw_only=True):
    """Something a person may want to read."""

    level: Annotated[str, Meta(pattern="^(info|warning|error)$")]
    text: Text
    about: Annotated[str, Meta(max_length=200)] = ""  # "sender/boot/sequence" of what is answered, if any


class TruthMessage(Message, frozen=True, kw_only=True):
    """Where the targets really are. For the viewer and the scoreboard; robots and fusion never read it."""

    targets: Array  # (d, n)
