import pytest

from planner.allocation.consensus import LEAVE, NOBODY, RESET, UPDATE, beats, verdict

I, K, M, N = 0, 1, 2, 3  # receiver, sender, a third and a fourth robot


def told(z_k, z_i, *, higher=False, newer_k=None, newer_i=False):
    """The verdict; newer_k None: the same time."""
    y_i, y_k = 5.0, 6.0 if higher else 4.0
    s_ik, s_kk = 5.0, {None: 5.0, True: 6.0, False: 4.0}[newer_k]
    s_ii, s_ki = 5.0, 6.0 if newer_i else 5.0
    return verdict(I, K, z_i, y_i, z_k, y_k, s_ii, s_ki, s_ik, s_kk)


@pytest.mark.parametrize(
    ("row", "z_k", "z_i", "given", "action"),
    [
        (1, K, I, {"higher": True}, UPDATE),
        (1, K, I, {}, LEAVE),
        (2, K, K, {}, UPDATE),
        (3, K, M, {"higher": True}, UPDATE),
        (3, K, M, {"newer_i": True}, UPDATE),
        (3, K, M, {}, LEAVE),
        (4, K, NOBODY, {}, UPDATE),
        (5, I, I, {"higher": True, "newer_i": True}, LEAVE),
        (6, I, K, {}, RESET),
        (7, I, M, {"newer_i": True}, RESET),
        (7, I, M, {"higher": True}, LEAVE),
        (8, I, NOBODY, {"higher": True}, LEAVE),
        (9, M, I, {"newer_k": True, "higher": True}, UPDATE),
        (9, M, I, {"newer_k": True}, LEAVE),
        (9, M, I, {"higher": True}, LEAVE),
        (10, M, K, {"newer_k": True}, UPDATE),
        (10, M, K, {"higher": True}, RESET),
        (11, M, M, {"newer_k": True}, UPDATE),
        (11, M, M, {"higher": True}, LEAVE),
        (12, M, N, {"newer_k": True, "newer_i": True}, UPDATE),
        (12, M, N, {"newer_k": True, "higher": True}, UPDATE),
        (12, M, N, {"newer_k": True}, LEAVE),
        (12, M, N, {"newer_k": False, "newer_i": True}, RESET),
        (12, M, N, {"newer_k": False, "higher": True}, LEAVE),
        (12, M, N, {"newer_i": True, "higher": True}, LEAVE),
        (13, M, NOBODY, {"newer_k": True}, UPDATE),
        (13, M, NOBODY, {"higher": True}, LEAVE),
        (14, NOBODY, I, {"newer_i": True}, LEAVE),
        (15, NOBODY, K, {}, UPDATE),
        (16, NOBODY, M, {"newer_i": True}, UPDATE),
        (16, NOBODY, M, {}, LEAVE),
        (17, NOBODY, NOBODY, {}, LEAVE),
    ],
)
def test_the_table_has_seventeen_rows(row, z_k, z_i, given, action):
    assert told(z_k, z_i, **given) == action


def test_equal_bids_go_to_the_first_robot_and_never_to_both():
    assert beats(2.0, 1, 2.0, 3)
    assert not beats(2.0, 3, 2.0, 1)
    assert not beats(0.0, 1, 0.0, NOBODY)
    assert beats(1.0, 3, 0.0, NOBODY)
