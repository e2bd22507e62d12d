"""The consensus table of CBBA: what a robot does with another's word about one task.

Source: Choi, Brunet, How, "Consensus-based decentralized auctions for robust task allocation", IEEE
Transactions on Robotics 25(4), 2009, table 1. The paper was not at hand: its seventeen rows are written out
from the rule behind them, and the tests hold them one by one. Of two statements about a robot's bid, the one
with the newer information on that robot holds; of two bids that may both be true, the higher holds; where
both sides rely on information that the other knows to be outdated, nobody is known to hold the task.

The table stands here once, for the state machine of one robot (`cbba`) and for the arrays of a whole team
(`engine`) alike. Equal bids are told apart by the robots' order, so that any two robots decide the same.
"""

from estimator.kernels import exact_kernel

NOBODY = -1  # as a winning agent
LEAVE, UPDATE, RESET = 0, 1, 2


@exact_kernel
def beats(y: float, robot: int, other_y: float, other: int) -> bool:
    """Whether bid `y` of `robot` wins over `other_y` of `other` (or of NOBODY, with 0)."""
    return y > other_y or (y == other_y and other != NOBODY and robot < other)


@exact_kernel
def verdict(
    i: int,
    k: int,
    z_i: int,
    y_i: float,
    z_k: int,
    y_k: float,
    s_ii: float,
    s_ki: float,
    s_ik: float,
    s_kk: float,
) -> int:
    """What receiver `i` does with sender `k`'s winning agent and bid for one task: LEAVE, UPDATE or RESET.

    Args:
        i, k: the two robots, by their rank in the team.
        z_i, y_i: winning agent (rank or NOBODY) and winning bid as the receiver believes.
        z_k, y_k: the same as the sender believes.
        s_ii, s_ki: timestamps of what receiver and sender know of robot z_i; anything if that is NOBODY.
        s_ik, s_kk: of what they know of robot z_k.
    """
    if z_k == NOBODY:
        if z_i in (i, NOBODY):
            return LEAVE
        return UPDATE if z_i == k or s_ki > s_ii else LEAVE
    if z_k == k:  # the sender believes in itself
        if z_i in (k, NOBODY) or beats(y_k, k, y_i, z_i):
            return UPDATE
        return UPDATE if z_i != i and s_ki > s_ii else LEAVE
    if z_k == i:  # in the receiver
        if z_i in (i, NOBODY):
            return LEAVE
        return RESET if z_i == k or s_ki > s_ii else LEAVE
    newer = s_kk > s_ik  # it believes in a third robot
    if z_i in (z_k, NOBODY):
        return UPDATE if newer else LEAVE
    if z_i == k:
        return UPDATE if newer else RESET
    higher = beats(y_k, z_k, y_i, z_i)
    if z_i == i:
        return UPDATE if newer and higher else LEAVE
    newer_i = s_ki > s_ii
    if newer and (newer_i or higher):
        return UPDATE
    return RESET if newer_i and s_kk < s_ik else LEAVE
