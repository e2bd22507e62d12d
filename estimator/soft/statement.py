"""One statement of an operator, as a filter takes it."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import IntArray
from estimator.sensors.softmax import Softmax
from estimator.soft.models import SoftModel


@dataclass(frozen=True, slots=True, eq=False)
class SoftObservation:
    """ "Something / nothing (or a named target, or not it) is <category> the model's reference".

    Raises:
        ValueError: if the model has no such category.
    """

    softmax: Softmax
    category: int
    positive: bool = True
    target: str | None = None  # None: something, or nothing

    def __post_init__(self) -> None:
        if not 0 <= self.category < self.softmax.categories:
            raise ValueError(f"category: expected 0..{self.softmax.categories - 1}, got {self.category}")

    @staticmethod
    def of(
        model: SoftModel, relation: str, *, positive: bool = True, target: str | None = None
    ) -> "SoftObservation":
        """The statement with a relation by its name, such as "near".

        Raises:
            ValueError: if the model has no such relation.
        """
        return SoftObservation(model.softmax, model.category(relation), positive, target)

    @property
    def own(self) -> IntArray:
        """The sub-classes that agree with the statement."""
        return np.flatnonzero((self.softmax.class_of == self.category) == self.positive)
