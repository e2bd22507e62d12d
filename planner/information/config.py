"""What a mission may say of the planners by Dames & Kumar 2015 (see `entropy`)."""

from typing import Annotated

import msgspec
from msgspec import Meta

from estimator.arrays import Count, NonNegative, Positive
from planner.information.conditional import TERMS

Mode = Annotated[int, Meta(ge=0, le=5)]
Growth = Annotated[float, Meta(gt=1)]
Steps = Annotated[int, Meta(ge=1, le=6)]
Limit = Annotated[int, Meta(ge=6, le=20)]


class InformationConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Modes, actions, and what the information is computed of. Defaults are the paper's if it has any."""

    mode: Mode = 2  # 0-3: by information; robots, length scales: 0 both at once, 1 scales in turn, 2 robots
    # in turn, 3 both in turn; 4, 5: random actions, of all scales or of each in turn
    steps: Steps = 3  # T, poses of an action
    first_scale_m: Positive | None = None  # shortest length scale; none: an eighth of the longest side
    growth: Growth = 1.2  # from one length scale to the next
    scales: Count = 12  # length scales, at most
    spread: Positive = 0.75  # R of Algorithm 1 in lengths: goals of a scale are this far apart
    lattice_m: Positive | None = (
        None  # between places that may be goals where there are obstacles; none: by area
    )
    points: Count = 600  # super-particles, at most
    cell_m: Positive | None = None  # side of a super-particle's cell; none: as small as `points` allow
    taylor_terms: Count = TERMS  # of (24)
    exact_steps: Limit = 12  # robot-steps whose information is exact; of more, the nearest
    expected_targets: Positive = 10.0  # in an unexplored area, before the first intensity is heard of
    settled: NonNegative | None = None  # epsilon of (27): the search is over below it; none: never
    settled_cell_m: Positive = 0.5  # how near places count as one for that
    replan_after: Count = 1  # of the T poses, after how many to plan again


class JointConfig(InformationConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """As of the planner for one robot, and how long to look for a joint action."""

    cycles: Count = 10  # through the robots of modes 2 and 3, at most
    max_joint: Count = 20_000  # joint actions to enumerate in modes 0 and 1; of more, as modes 2 and 3
