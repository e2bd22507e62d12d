"""What the benchmarks share: which figures to measure, and how thoroughly."""

import pytest

from benchmarks.results import default_name


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="Shorter runs, rougher figures.")
    parser.addoption("--figure", action="append", default=[], help="Measure only this one. Repeatable.")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "figures(*names): what a benchmark measures; else the test's name")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    wanted = set(config.getoption("--figure"))
    if not wanted:
        return
    names = {item.nodeid: _names(item) for item in items}
    unknown = wanted.difference(*names.values())
    if unknown:
        known = ", ".join(sorted(set().union(*names.values())))
        raise pytest.UsageError(f"no figure {', '.join(sorted(unknown))}; there are {known}")
    config.hook.pytest_deselected(items=[item for item in items if not names[item.nodeid] & wanted])
    items[:] = [item for item in items if names[item.nodeid] & wanted]


def _names(item: pytest.Item) -> set[str]:
    marker = item.get_closest_marker("figures")
    return set(marker.args) if marker else {default_name(item.name)}


@pytest.fixture(scope="session")
def quick(request: pytest.FixtureRequest) -> bool:
    """Whether a rough figure will do."""
    return bool(request.config.getoption("--quick"))
