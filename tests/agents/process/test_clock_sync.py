"""A process's clock kept at the team's: asker, answers and correction together, over a jittery network."""

import numpy as np
import pytest

from agents.clock import Correction
from agents.mission.mission import ClockTable
from agents.process.clock_sync import ClockAnswers, ClockState, ClockSync
from agents.wire import codec
from agents.wire.messages import ClockMessage, StartMessage
from agents.wire.topics import CLOCK, START

TABLE = ClockTable()


class Pair:
    """A robot and a fusion; `raw` is the robot's clock as a function of team time."""

    def __init__(self, offset: float, drift: float = 0.0, table: ClockTable = TABLE) -> None:
        self.offset, self.drift = offset, drift
        self.sync = ClockSync("r1", "b", table)
        self.answers = ClockAnswers()
        self.correction = Correction()
        self.sequence = 0

    def raw(self, team: float) -> float:
        return team * (1.0 + self.drift) - self.offset

    def shown(self, team: float) -> float:
        return self.correction.team(self.raw(team))

    def ask(self, team: float, there: float, held: float, back: float, fusion: str = "fusion") -> float:
        """One exchange that begins at team time `team`; when it ends."""
        header = {"team": "t", "boot": "b", "sequence": self.sequence}
        self.sequence += 1
        question = ClockMessage(**header, sender="r1", time=self.shown(team), shown=self.raw(team))
        question = codec.decode(CLOCK, codec.encode(question), team="t", sender="r1")  # type: ignore[assignment]
        self.answers.hear(question, team + there)
        answer = StartMessage(
            **header,
            sender=fusion,
            time=team + there + held,
            epoch=0.0,
            speed=1.0,
            seed=1,
            mission_hash="x",
            answers=self.answers.take(),
        )
        answer = codec.decode(START, codec.encode(answer), team="t", sender=fusion)  # type: ignore[assignment]
        end = team + there + held + back
        before = self.sync.correction
        self.sync.hear(answer, self.raw(end))
        if self.sync.correction != before:
            self.correction.set(self.sync.correction, self.raw(end))
        return end


@pytest.mark.parametrize("offset", [-5.0, -0.3, 0.02, 5.0])
@pytest.mark.parametrize("seed", range(3))
def test_an_offset_clock_ends_in_team_time(offset: float, seed: int) -> None:
    rng, pair = np.random.default_rng(seed), Pair(offset)
    for i in range(30):
        pair.ask(float(i), *(0.001 + rng.exponential(0.004, 3)))
    assert pair.sync.state is ClockState.CORRECTED
    assert abs(pair.shown(60.0) - 60.0) < 0.005, f"offset {offset}, seed {seed}"


@pytest.mark.parametrize("drift", [1e-4, -1e-4, 2e-3])
def test_a_drifting_clock_is_kept_at_team_time(drift: float) -> None:
    rng, pair = np.random.default_rng(3), Pair(1.0, drift)
    worst = 0.0
    for i in range(300):
        pair.ask(float(i), *(0.001 + rng.exponential(0.002, 3)))
        if i > 20:
            worst = max(worst, abs(pair.shown(i + 0.5) - i - 0.5))
    assert worst < 0.025, f"drift {drift}, numpy seed 3"


@pytest.mark.parametrize("seed", range(5))
def test_a_clock_that_nothing_shows_to_be_wrong_is_left_alone(seed: int) -> None:
    rng, pair = np.random.default_rng(seed), Pair(0.0)
    for i in range(100):
        pair.ask(float(i), *rng.exponential(0.05, 3))
    assert pair.sync.state is ClockState.RIGHT
    assert pair.sync.correction == 0.0, f"seed {seed}"
    assert pair.shown(200.0) == 200.0


@pytest.mark.parametrize("offset", [-30.0, 10.2, 1e6])
def test_an_offset_beyond_the_limit_is_refused_and_said_in_one_sentence(offset: float) -> None:
    pair = Pair(offset)
    pair.ask(0.0, 0.01, 0.0, 0.01)
    assert pair.sync.state is ClockState.REFUSED
    assert not pair.sync.trusted
    assert pair.sync.correction == 0.0
    side = "behind" if offset > 0 else "ahead of"
    sentence = pair.sync.sentence("r1")
    assert f"{abs(offset):.3f} s {side} the team's" in sentence
    assert "clock.correct_up_to_s is 10" in sentence


def test_a_slow_network_alone_is_no_reason_to_refuse_a_clock() -> None:
    pair = Pair(1.0)
    pair.ask(0.0, 60.0, 0.0, 1.0)
    assert pair.sync.trusted


def test_a_refused_clock_that_is_set_right_is_trusted_again() -> None:
    pair = Pair(-30.0)
    pair.ask(0.0, 0.01, 0.0, 0.01)
    assert not pair.sync.trusted
    pair.offset = 0.0
    pair.ask(60.0, 0.01, 0.0, 0.01)
    assert pair.sync.trusted


def test_answers_to_others_and_to_an_earlier_boot_are_ignored() -> None:
    sync = ClockSync("r1", "b2", TABLE)
    message = StartMessage(
        team="t",
        sender="fusion",
        boot="f",
        sequence=0,
        time=5.0,
        epoch=0.0,
        speed=1.0,
        seed=1,
        mission_hash="x",
        answers={"r1/b1": np.array([0.0, 5.0]), "r2/b2": np.array([0.0, 5.0])},
    )
    assert not sync.hear(message, 1.0)
    assert sync.state is ClockState.UNKNOWN


def test_of_two_fusions_all_follow_the_same_and_go_over_when_it_falls_silent() -> None:
    pair = Pair(2.0)
    now = 0.0
    for _ in range(3):
        now = pair.ask(now + 1.0, 0.001, 0.0, 0.001, "fusion2")
        now = pair.ask(now + 1.0, 0.001, 0.0, 0.001, "fusion1")
    assert sorted(pair.sync._references) == ["fusion1", "fusion2"]
    pair.offset = 3.0  # that is what fusion2 says from now on; the clock itself did not change
    now = pair.ask(now + 1.0, 0.001, 0.0, 0.001, "fusion2")
    assert pair.sync.correction == pytest.approx(2.0, abs=0.01)
    for _ in range(8):
        now = pair.ask(now + 1.0, 0.001, 0.0, 0.001, "fusion2")
    assert pair.sync.correction == pytest.approx(3.0, abs=0.01)


def test_the_first_question_of_a_boot_is_told_from_the_next() -> None:
    answers = ClockAnswers()
    question = ClockMessage(team="t", sender="r1", boot="b", sequence=0, time=0.0, shown=0.0)
    assert answers.hear(question, 1.0)
    assert not answers.hear(question, 2.0)
    assert answers.take()["r1/b"].tolist() == [0.0, 2.0]
    assert answers.take() == {}


@pytest.mark.parametrize("seed", range(20))
def test_a_corrected_clock_never_goes_back_and_its_waits_are_exact(seed: int) -> None:
    rng, correction = np.random.default_rng(seed), Correction()
    raw, shown, target = 0.0, 0.0, 0.0
    for _ in range(200):
        raw += rng.exponential(0.2)
        if rng.random() < 0.1:
            target = rng.normal(0.0, 2.0)
            correction.set(target, raw)
        now = correction.team(raw)
        assert now >= shown - 1e-12, f"seed {seed}"
        shown = now
        team = now + rng.exponential(1.0)
        assert correction.team(raw + correction.wait(team, raw)) == pytest.approx(team, abs=1e-9)
    assert correction.team(raw + 100.0) == pytest.approx(raw + 100.0 + target)


def test_a_clock_behind_is_put_forward_at_once_and_one_ahead_runs_at_half_speed() -> None:
    behind, ahead = Correction(), Correction()
    behind.set(2.0, 10.0)
    assert behind.team(10.0) == 12.0
    ahead.set(-2.0, 10.0)
    assert ahead.team(10.0) == 10.0
    assert ahead.team(12.0) == 11.0
    assert ahead.team(14.0) == 12.0
    assert ahead.team(20.0) == 18.0
