"""The shared contract (contract.py) of every filter that a mission can name.

A new filter is found by its entry point and needs nothing here, unless its mission table should differ from
the defaults (TABLES) or it cannot promise something by its nature (EXCUSED, with the reason).
"""

import pytest

from agents import plugins
from tests.estimator import contract

TABLES: dict[str, dict[str, object]] = {"smc_phd": {"particles": 2000}, "mixtures": {"unnamed": 3}}
COUNTS = {"kalman": 1}  # targets that a filter can hold, where not any number
EXCUSED: dict[tuple[str, str], str] = {
    ("lmb", "an_empty_set_takes_mass_where_the_sensor_looked"): (
        "a track that is certain to exist stays so when missed; tests/estimator/lmb has the exact factor"
    )
}
CASES = [
    contract.Case(kind, d, TABLES.get(kind, {}), COUNTS.get(kind, 3))
    for kind in plugins.kinds("filters")
    for d in (2, 3)
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.kind}-{case.dimension}d")
@pytest.mark.parametrize("promise", contract.PROMISES, ids=lambda promise: promise.__name__)
def test_every_filter_promises_that(promise: object, case: contract.Case) -> None:
    assert callable(promise)
    reason = EXCUSED.get((case.kind, promise.__name__))
    if reason:
        pytest.skip(reason)
    promise(case)
