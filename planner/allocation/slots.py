"""Tasks that need several robots at once: one slot for each, which are allocated like tasks of their own.

A robot takes at most one slot of a task. A task of which not all slots are taken in the end is of no use to
anybody: the least of them is withdrawn, and its robots bid for other tasks (as coupled constraints are
relaxed in Whitten, Choi, Johnson, How, "Decentralized task allocation with coupled constraints in complex
missions", ACC 2011).
"""

from collections.abc import Iterable, Mapping


def slots(task: str, robots: int) -> tuple[str, ...]:
    """The names under which a task that needs so many robots is allocated; its own name for one.

    Raises:
        ValueError: if the number is not positive, or the name could be taken for that of a slot.
    """
    if robots < 1:
        raise ValueError(f"robots: expected at least one for task {task!r}, got {robots}")
    if "#" in task:
        raise ValueError(f"task: expected a name without '#', got {task!r}")
    return (task,) if robots == 1 else tuple(f"{task}#{n}" for n in range(1, robots + 1))


def task_of(slot: str) -> str:
    """The task that a slot belongs to."""
    return slot.partition("#")[0]


def incomplete(
    needed: Mapping[str, int], winning_agents: Mapping[str, str], winning_bids: Mapping[str, float]
) -> str | None:
    """Of the tasks with some of their slots taken but not all, the one with the lowest sum of bids.

    Args:
        needed: robots that each task needs.
        winning_agents, winning_bids: by slot, as agreed.
    """
    taken: dict[str, list[float]] = {}
    for slot in winning_agents:
        taken.setdefault(task_of(slot), []).append(winning_bids[slot])
    short = [(sum(bids), task) for task, bids in taken.items() if len(bids) < needed.get(task, 1)]
    return min(short)[1] if short else None


def without_task(slot_names: Iterable[str], task: str) -> list[str]:
    """The slots that are left when a task is withdrawn, in their order."""
    return [slot for slot in slot_names if task_of(slot) != task]
