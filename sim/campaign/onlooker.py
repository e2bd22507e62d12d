"""Somebody who watches a run in virtual time, and may interfere where the engine says it has come to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from agents.wire.messages import Message
from agents.wire.topics import Topic
from planner.plan import PlanProblem

if TYPE_CHECKING:
    from sim.engine.nodes import Node

Turn = Literal["up", "down", "stopped", "going"]


class Onlooker:
    """Does nothing; others do more."""

    def said(self, node: Node, topic: Topic, message: Message) -> None:
        """A process sends a message."""

    def lived(self, node: Node, turn: Turn) -> None:
        """A process started, ended, was stopped or goes on."""

    def at(self, node: Node, point: str) -> None:
        """A process is between two actions, at a point such as "before store"; it may be killed here."""

    def asked(self, node: Node, problem: PlanProblem) -> None:
        """A robot asks for a plan."""
