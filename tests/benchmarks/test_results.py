"""benchmarks/results.json: from pytest-benchmark's report, merged, and shown."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import report, results

MACHINE = {"cpu": "Abacus 2", "cores": 2, "python": "3.11.7"}
VERSIONS = {"numpy": "2.0.0"}


def benchmark(test: str, median_s: float = 0.002, **extra_info: Any) -> dict[str, Any]:
    """One entry of pytest-benchmark's file."""
    return {
        "name": test,
        "stats": {"median": median_s, "min": median_s / 2, "rounds": 3},
        "extra_info": extra_info,
    }


def figures(*benchmarks: dict[str, Any]) -> list[results.Figure]:
    return results.figures({"benchmarks": list(benchmarks)}, MACHINE, VERSIONS)


def test_a_benchmark_without_words_gives_its_median_in_ms_under_its_own_name() -> None:
    (figure,) = figures(benchmark("test_link_round_trip[40hz]"))
    assert (figure["name"], figure["value"], figure["unit"]) == ("link_round_trip_40hz", 2.0, "ms")
    assert figure["asked"] is None
    assert results.reached(figure) is None
    assert figure["more"] == {"min": 1.0, "rounds": 3}


def test_words_of_the_benchmark_come_through() -> None:
    (figure,) = figures(benchmark("test_x", unit="s", asked=5.0, peers={"other": 9.0}, note="cold"))
    assert figure["value"] == 0.002
    assert (figure["asked"], figure["peers"], figure["note"]) == (5.0, {"other": 9.0}, "cold")
    assert (figure["machine"], figure["versions"]) == (MACHINE, VERSIONS)


def test_one_benchmark_may_give_several_figures() -> None:
    several = [{"name": "a", "value": 1, "unit": "MB"}, {"name": "b", "value": 2, "unit": "x"}]
    assert [figure["name"] for figure in figures(benchmark("test_x", figures=several))] == ["a", "b"]


def test_two_benchmarks_of_one_figure_are_refused() -> None:
    with pytest.raises(ValueError, match="more than one benchmark gives x"):
        figures(benchmark("test_x"), benchmark("test_y", name="x"))


def test_a_median_in_a_unit_that_is_no_time_is_refused() -> None:
    with pytest.raises(ValueError, match="test_x"):
        figures(benchmark("test_x", unit="MB"))


@pytest.mark.parametrize(
    ("value", "better", "expected"),
    [
        (4.0, "less", True),
        (5.0, "less", True),
        (6.0, "less", False),
        (6.0, "more", True),
        (4.0, "more", False),
    ],
)
def test_a_figure_is_reached_on_the_right_side_of_what_is_asked(
    value: float, better: str, expected: bool
) -> None:
    assert results.reached({"value": value, "asked": 5.0, "better": better}) is expected


def test_a_figure_that_could_not_be_measured_is_not_reached() -> None:
    assert results.reached({"value": None, "asked": 5.0}) is False


def test_a_partial_run_replaces_only_what_it_measured(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    assert results.read(path) == []
    results.write(figures(benchmark("test_a"), benchmark("test_b")), path)
    results.write(
        results.merged(results.read(path), figures(benchmark("test_c"), benchmark("test_a", 9.0))), path
    )
    recorded = json.loads(path.read_text())
    assert [(f["name"], f["value"]) for f in recorded] == [("a", 9000.0), ("b", 2.0), ("c", 2.0)]
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]


def test_the_page_shows_measured_against_asked_and_the_machine() -> None:
    page = report.markdown(
        figures(
            benchmark("test_quick", asked=5.0, peers={"other library": 720.0}, note="one thread"),
            benchmark("test_slow", value=40.0, unit="x", asked=50.0, better="more"),
        )
    )
    assert "Abacus 2, 2 cores, Python 3.11.7; numpy 2.0.0" in page
    assert (
        "| `quick` | 2 ms | at most 5 ms | yes | other library: 720 ms | one thread; min 1; rounds 3 |"
        in page
    )
    assert "| `slow` | 40 x | at least 50 x | no |  |  |" in page


def test_the_page_of_the_repository_is_that_of_its_record() -> None:
    assert report.DOCS.read_text() == report.markdown(results.read()), "run: python -m benchmarks --docs"
