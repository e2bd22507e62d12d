"""The allocation agents of a team over networks that lose, delay and split, and among robots that die."""

import numpy as np
import pytest

from agents.allocation.others import TeamWords
from agents.wire.messages import BidMessage, RequestMessage, Wish
from planner.allocation.cbba import AllocationState
from tests.agents.hall import LEASE_S, RULES, Hall

PLACES = {"r1": (10.0, 10.0), "r2": (90.0, 10.0), "r3": (10.0, 90.0), "r4": (90.0, 90.0)}
AT_MOST_S = 2.0  # beyond liveliness: from a robot's death to its tasks' new holders
DOUBLE_S = 3.0  # T: after a heal no task is held twice for longer


def repeat(seed: int) -> str:
    return f"repeat with: pytest tests/agents/allocation/test_allocation.py -k 'seed and {seed}'"


def wish(name: str = "request-door", x: float = 50.0, y: float = 50.0, **changes: object) -> Wish:
    table = {"worth": 3.0, "robots": 1, "needs": [], "asked": 1.0} | changes
    return Wish(name=name, place=[x, y], **table)  # type: ignore[arg-type]


def ask(hall: Hall, made: Wish) -> None:
    header = {"team": "t", "sender": "op", "boot": "b", "sequence": 0, "time": made.asked}
    hall.request(RequestMessage(**header, wish=made))  # type: ignore[arg-type]


def double_spells(hall: Hall, since: float) -> float:
    """The last moment at which any task was held twice, as robots said, after `since`."""
    spans = [h for h in hall.ownership.holdings(hall.now) if h.end > since]
    last = since
    for a in spans:
        for b in spans:
            if a.slot == b.slot and a.robot < b.robot and min(a.end, b.end) > max(a.start, b.start):
                last = max(last, min(a.end, b.end))
    return last


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_a_team_holds_every_task_once_and_agrees(seed: int, loss: float) -> None:
    hall = Hall(PLACES, seed=seed, loss=loss).run(6.0)
    assert hall.settled(), repeat(seed)
    assert set(hall.owners()) == hall.tasks(), repeat(seed)
    assert sum(len(node.agent.path) for node in hall.nodes.values()) == len(hall.tasks()) >= 8


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_a_dead_robots_tasks_are_taken_over_within_two_seconds_of_its_token(seed: int, loss: float) -> None:
    hall = Hall(PLACES, seed=seed, loss=loss).run(6.0 + 0.1 * seed)
    dead = f"r{seed + 1}"
    orphans = [slot for slot, who in hall.owners().items() if who == [dead]]
    assert orphans
    hall.kill(dead)
    hall.run(hall.now + LEASE_S + AT_MOST_S)
    held = hall.owners()
    assert all(len(held.get(slot, [])) == 1 for slot in orphans), repeat(seed)
    assert hall.run(hall.now + 1.0).settled(), repeat(seed)
    told = [text for _, text in hall.events if f"from {dead}, which is gone" in text]
    assert told
    counted = sum(node.agent.counters().get("tasks_taken_over", 0) for node in hall.nodes.values())
    assert counted >= len(orphans)


def test_what_a_robot_said_before_it_died_does_not_bring_it_back() -> None:
    """Its last word is underway for longer than its token takes to go."""
    hall = Hall(PLACES, delay=0.4).run(6.0)
    hall.nodes["r2"].agent.renew(hall.now)
    hall._step(hall.nodes["r2"])
    hall.kill("r2", lease=0.05)
    hall.run(hall.now + 0.06)
    assert not hall.nodes["r1"].agent.team.here("r2")
    for _ in range(30):
        hall.run(hall.now + 0.05)
        assert not any(node.agent.team.here("r2") for node in hall.nodes.values() if node.alive)


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_after_a_split_each_side_holds_all_and_after_the_heal_nothing_twice_for_long(
    seed: int, loss: float
) -> None:
    hall = Hall(PLACES, seed=seed, loss=loss, clusters=3, regions=2).run(5.0)
    hall.cut(("r1", "r2"), ("r3", "r4"))
    hall.run(10.0)
    held = hall.owners()
    assert all(sorted(a in ("r1", "r2") for a in who) == [False, True] for who in held.values()), repeat(seed)
    assert set(held) == hall.tasks()
    hall.heal()
    healed = hall.now
    hall.run(healed + DOUBLE_S)
    assert hall.settled(), repeat(seed)
    assert double_spells(hall, healed) - healed <= DOUBLE_S
    assert max(node.agent.gauges()["double_owned_s"] for node in hall.nodes.values()) > 0.0


@pytest.mark.parametrize("offset", [0.0, -500.0])
def test_a_robot_that_is_reborn_is_believed_also_with_a_clock_behind_its_former_lifes(offset: float) -> None:
    hall = Hall(PLACES).run(5.0)
    hall.kill("r1")
    hall.run(9.0)
    assert "r1" not in {robot for who in hall.owners().values() for robot in who}
    hall.join("r1", PLACES["r1"], boot=1, offset=offset)
    hall.run(13.0)
    assert hall.settled()
    assert hall.nodes["r1"].agent.path  # what is near to it is its own again
    spoke = [m.said for t, m in hall.words if m.sender == "r1" and t > 9.5]
    assert spoke == sorted(spoke)
    assert spoke[0] > max(m.said for t, m in hall.words if m.sender == "r1" and t < 9.0)


def test_a_robot_that_hangs_with_its_token_standing_is_given_up_after_a_while() -> None:
    hall = Hall(PLACES).run(5.0)
    hall.freeze("r4")
    hall.run(5.0 + RULES.silence_s - 0.6)
    assert hall.nodes["r1"].agent.team.here("r4")
    hall.run(5.0 + RULES.silence_s + 1.0)
    others = [hall.nodes[name].agent for name in ("r1", "r2", "r3")]
    assert not any(agent.team.here("r4") for agent in others)
    assert {slot for agent in others for slot in agent.state.bundle} == hall.tasks()
    hall.go_on("r4")
    assert hall.run(hall.now + DOUBLE_S).settled()


def test_words_pass_over_robots_between_and_so_does_the_news_of_a_death() -> None:
    """A line: r1 and r3 hear only r2, and see no token of each other."""
    places = {name: PLACES[name] for name in ("r1", "r2", "r3")}
    hall = Hall(places, silent_tokens=[("r1", "r3")], clusters=2, regions=2)
    hall.links = {("r1", "r2"), ("r2", "r1"), ("r2", "r3"), ("r3", "r2")}
    hall.run(8.0)
    assert hall.settled()
    assert hall.nodes["r1"].agent.team.here("r3")
    assert set(hall.owners()) == hall.tasks()
    hall.run(16.0)
    assert hall.settled()
    hall.kill("r3")
    hall.run(16.0 + LEASE_S + AT_MOST_S)
    assert not hall.nodes["r1"].agent.team.here("r3")
    assert set(hall.owners()) == hall.tasks()


def test_robots_go_on_speaking_when_all_is_agreed() -> None:
    hall = Hall(PLACES).run(10.0)
    late = [m.sender for t, m in hall.words if t > 8.0]
    assert all(late.count(name) >= 4 for name in PLACES)
    assert len(late) <= 4 * (2.0 / RULES.heartbeat_s + 2)  # and no more than that
    # Who was deaf to all of it learns it from the next heartbeats.
    hall.cut(("r1",), ("r2", "r3", "r4"), lease=1e9)
    hall.nodes["r1"].agent.team = TeamWords(
        AllocationState.start("r1", list(PLACES), RULES.capacity), heartbeat_s=0.5, silence_s=5.0
    )
    hall.heal(after=1e9)
    assert hall.run(12.0).settled()


def test_a_robot_bids_for_what_it_can_do_only() -> None:
    can = {"r1": {"capabilities": ["explore"]}, "r2": {"capabilities": ["refine"]}}
    hall = Hall(PLACES, clusters=12, **can).run(5.0)
    for name, kind in (("r1", "explore"), ("r2", "refine")):
        agent = hall.nodes[name].agent
        assert agent.path
        assert all(task.startswith(kind) for task in agent.path)
        assert {task.kind for task in agent.assignment().tasks} == {kind}
    assert set(hall.owners()) == {task for node in hall.nodes.values() for task in node.agent.path}


def test_a_request_goes_round_is_done_by_a_look_and_does_not_come_back() -> None:
    hall = Hall(PLACES, clusters=0, regions=1).run(2.0)
    hall.links -= {("r1", "r2")}
    hall.nodes["r1"].agent.hear(hall.now, request_message(wish(x=88.0, y=12.0)))  # only r1 hears the operator
    hall.run(4.0)
    assert hall.owners()["request-door"] == ["r2"]  # it is nearest, and heard of it from others
    hall.looked("r2", (60.0, 12.0, 5.0, 0.0))  # too far away
    assert hall.run(5.0).owners()["request-door"] == ["r2"]
    hall.nodes["r2"].agent.looked(hall.now, "r2", np.array([88.0, 11.0, 5.0, 0.0]))  # only r2 knows that
    hall.run(7.0)
    assert "request-door" not in hall.owners()
    assert "r2: request-door is done" in [text for _, text in hall.events]
    ask(hall, wish(x=88.0, y=12.0))  # the operator's word again, late
    assert "request-door" not in hall.run(9.0).owners()
    ask(hall, wish(x=88.0, y=12.0, asked=9.0))  # asked anew
    assert "request-door" in hall.run(11.0).owners()
    ask(hall, wish(x=88.0, y=12.0, asked=11.0, worth=0.0))  # withdrawn
    assert "request-door" not in hall.run(13.0).owners()


def request_message(made: Wish) -> RequestMessage:
    return RequestMessage(team="t", sender="op", boot="b", sequence=0, time=made.asked, wish=made)


def test_of_robots_that_a_request_needs_each_must_be_able_and_looks_once() -> None:
    can = {name: {"capabilities": ["request", "camera"]} for name in ("r1", "r4")}
    hall = Hall(PLACES, clusters=0, regions=1, **can).run(2.0)
    ask(hall, wish(robots=2, needs=["camera"]))
    held = hall.run(4.0).owners()
    slots = {slot: who for slot, who in held.items() if slot.startswith("request")}
    assert sorted(slots) == ["request-door#1", "request-door#2"]
    assert sorted(who[0] for who in slots.values()) == ["r1", "r4"]
    hall.looked("r2", (50.0, 50.0, 5.0, 0.0))  # passes by, was not asked
    hall.looked("r1", (50.0, 49.0, 5.0, 0.0))
    held = hall.run(6.0).owners()
    assert held["request-door"] == ["r4"]  # one more look; r1 has done its part
    hall.looked("r4", (49.0, 50.0, 5.0, 0.0))
    assert not any(slot.startswith("request") for slot in hall.run(8.0).owners())


@pytest.mark.parametrize("name", ["explore-2", "request-high"])
def test_requests_that_are_none_are_passed_over(name: str) -> None:
    """One has the name of a region, the other three axes in a plane."""
    hall = Hall(PLACES, clusters=0, regions=1).run(1.0)
    place = [1.0, 2.0] if name == "explore-2" else [1.0, 2.0, 3.0]
    ask(hall, Wish(name=name, place=place, worth=9.0, robots=1, needs=[], asked=1.0))
    assert not hall.nodes["r1"].agent.requests.wishes()


def test_a_robot_with_a_plan_for_its_own_task_goes_before_one_that_helps() -> None:
    hall = Hall(PLACES).run(5.0)
    agent = hall.nodes["r3"].agent
    mine, theirs = agent.path[0], hall.nodes["r1"].agent.path[0]
    assert agent.yields("", theirs, "r1")  # r1 holds what it plans for
    assert not agent.yields(mine, "", "r1")
    assert agent.yields(mine, theirs, "r1")  # both hold: the first in order
    assert not agent.yields(mine, hall.nodes["r4"].agent.path[0], "r4")
    assert not agent.yields(mine, mine, "r1")  # it helps with a task of r3's


def word(sender: str, said: float, **changes: object) -> BidMessage:
    table: dict[str, object] = {
        "tasks": ["t"],
        "places": np.zeros((1, 2)),
        "path": [],
        "winning_bids": {},
        "winning_agents": {},
        "timestamps": {},
        "digests": {},
    }
    header = {"team": "t", "sender": sender, "boot": "b", "sequence": 0, "time": said}
    return BidMessage(**header, said=said, **(table | changes))  # type: ignore[arg-type]


def test_strangers_and_times_that_are_none_are_refused_and_counted() -> None:
    team = TeamWords(AllocationState.start("a", "ab", 2), heartbeat_s=0.5, silence_s=5.0)
    before = team.state
    assert not team.hear(1.0, word("x", 1.0))
    assert not team.hear(1.0, word("b", 1e300))
    assert not team.hear(1.0, word("b", 1.0, timestamps={"a": 1e300}))
    assert team.state == before
    assert team.counters["bids_refused"] == 3
    assert team.tick(1.0) < 2.0
    assert team.hear(1.0, word("b", 1.0))  # nothing of that is held against the sender
    assert team.here("b")


def test_a_robot_that_does_not_know_of_a_task_says_nothing_of_it() -> None:
    """b heard c later than a did, but does not know the task: that is no word that c gave it up."""
    team = TeamWords(AllocationState.start("a", "abc", 2), heartbeat_s=0.5, silence_s=5.0)
    team.hear(1.0, word("c", 1.0, winning_bids={"t": 2.0}, winning_agents={"t": "c"}))
    assert team.state.winning_agents == {"t": "c"}
    team.hear(1.5, word("b", 1.5, tasks=[], places=np.zeros((0, 2)), timestamps={"c": 1.4}))
    assert team.state.winning_agents == {"t": "c"}
    team.hear(1.6, word("b", 1.6, timestamps={"c": 1.5}))  # now it knows it, and that nobody holds it
    assert team.state.winning_agents == {}
    team.hear(2.0, word("c", 2.0, winning_bids={"t": 2.0}, winning_agents={"t": "c"}))
    team.hear(2.5, word("c", 2.5, tasks=[], places=np.zeros((0, 2))))  # of its own it always speaks
    assert team.state.winning_agents == {}
