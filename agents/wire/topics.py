"""The topic table: all that is said in a team, how it is carried, and what happens when it is late.

Transports, mailboxes, health, viewer and docs read this one table.
"""

from dataclasses import dataclass
from enum import Enum

from agents.wire import messages as m


class Drop(Enum):
    """What a full queue gives up."""

    OLDEST = "oldest"
    LATEST_ONLY = "latest only"  # one per sender is kept


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table."""

    name: str
    message: type[m.Message]
    reliable: bool  # recovered when lost, and shown to late joiners
    history: int  # how many of each sender's last messages a late joiner is given
    rate_hz: float  # usual rate per sender in team time, for health; 0 = on occasion
    queue: int  # bound of a receiver's queue, messages
    drop: Drop
    max_bytes: int
    stale_after_s: float  # age at which the value is no longer used; 0 = never
    when_stale: str  # what the receiver then does


POSE = Topic("pose", m.PoseMessage, False, 0, 5.0, 256, Drop.LATEST_ONLY, 2_000, 2.0, "peer counts as silent")
SET = Topic("set", m.MeasurementSetMessage, True, 64, 1.0, 4096, Drop.OLDEST, 200_000, 0.0, "never")
SOFT_OBSERVATION = Topic(
    "soft_observation", m.SoftObservationMessage, True, 64, 0.0, 1024, Drop.OLDEST, 4_000, 0.0, "never"
)
PLAN = Topic(
    "plan", m.PlanMessage, True, 1, 0.1, 256, Drop.LATEST_ONLY, 400_000, 0.0, "robot stands at its end"
)
POSTERIOR = Topic(
    "posterior",
    m.PosteriorMessage,
    True,
    1,
    1.0,
    16,
    Drop.LATEST_ONLY,
    2_000_000,
    10.0,
    "robot goes on with the last",
)
PICTURE = Topic(
    "picture",
    m.PictureMessage,
    True,
    1,
    1.0,
    4,
    Drop.LATEST_ONLY,
    8_000_000,
    10.0,
    "robot goes on with the last",
)
BID = Topic("bid", m.BidMessage, False, 0, 2.0, 1024, Drop.LATEST_ONLY, 200_000, 5.0, "robot counts as gone")
REQUEST = Topic("request", m.RequestMessage, True, 16, 0.0, 256, Drop.OLDEST, 4_000, 0.0, "never")
RESUME = Topic("resume", m.ResumeMessage, False, 0, 0.0, 16, Drop.OLDEST, 1_000, 0.0, "never")
STATE = Topic("state", m.StateMessage, True, 1, 0.1, 2, Drop.LATEST_ONLY, 16_000_000, 0.0, "never")
BELIEF = Topic("belief", m.BeliefMessage, False, 0, 1.0, 256, Drop.LATEST_ONLY, 2_000_000, 10.0, "not shown")
LEDGER = Topic("ledger", m.LedgerMessage, False, 0, 1.0, 64, Drop.OLDEST, 2_000_000, 0.0, "never")
RELAY = Topic("relay", m.RelayMessage, False, 0, 0.0, 256, Drop.OLDEST, 4_000_000, 0.0, "never")
START = Topic("start", m.StartMessage, True, 1, 1.0, 16, Drop.LATEST_ONLY, 200_000, 0.0, "never")
CLOCK = Topic("clock", m.ClockMessage, False, 0, 1.0, 1024, Drop.OLDEST, 1_000, 0.0, "never")
HEALTH = Topic("health", m.HealthMessage, True, 1, 1.0, 256, Drop.LATEST_ONLY, 100_000, 5.0, "shown silent")
EVENT = Topic("event", m.EventMessage, True, 16, 0.0, 1024, Drop.OLDEST, 4_000, 0.0, "never")
TRUTH = Topic("truth", m.TruthMessage, True, 1, 1.0, 4, Drop.LATEST_ONLY, 2_000_000, 0.0, "never")

TOPICS: dict[str, Topic] = {
    t.name: t
    for t in (
        POSE,
        SET,
        SOFT_OBSERVATION,
        PLAN,
        BID,
        REQUEST,
        RESUME,
        POSTERIOR,
        PICTURE,
        STATE,
        BELIEF,
        LEDGER,
        RELAY,
        START,
        CLOCK,
        HEALTH,
        EVENT,
        TRUTH,
    )
}


def key(team: str, topic: Topic | str, sender: str) -> str:
    """The key a sender publishes a topic on."""
    name = topic if isinstance(topic, str) else topic.name
    return f"{team}/v{m.SCHEMA_VERSION}/{name}/{sender}"
