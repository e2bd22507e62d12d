"""`simulate --compare`: planners on the same seeds, differences seed by seed, what decentralisation costs."""

import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from agents.cli import app
from agents.errors import MissionError
from agents.mission.mission_file import load
from sim.simulate.compare import decentralisation, differences, sentences, variants, with_planner
from sim.simulate.statistics import paired

MISSION = str(Path(__file__).resolve().parents[3] / "missions" / "quickstart.toml")


def run(seed: int, time: float | None, distance: float = 10.0) -> dict[str, Any]:
    return {
        "seed": seed,
        "all_found": time is not None,
        "time_to_all_found_s": time,
        "distance_travelled_m": {"r1": distance, "r2": 1.0},
        "plan_ms": {"p50": 3.0},
    }


def test_differences_are_taken_seed_by_seed_where_both_runs_have_the_value() -> None:
    mine = [run(0, 10.0), run(1, 30.0), run(2, None), run(3, 50.0)]
    theirs = [run(0, 8.0), run(1, 24.0), run(2, 5.0), run(3, 46.0)]
    value = paired(mine, theirs, ["time_to_all_found_s"])["time_to_all_found_s"]
    assert value["n"] == 3
    assert value["mean"] == 4.0
    # Student's t at 97.5 % with 2 degrees of freedom is 4.302653; the differences are 2, 6 and 4
    assert value["half_width_95"] == pytest.approx(4.302653 * 2.0 / math.sqrt(3.0))


def test_runs_of_other_seeds_are_not_paired() -> None:
    with pytest.raises(ValueError, match="same seeds"):
        paired([run(0, 1.0)], [run(1, 1.0)], ["time_to_all_found_s"])


def test_what_decentralisation_costs_is_told_only_beside_the_joint_sibling() -> None:
    alone = {"maasi": [run(0, 10.0), run(1, 12.0)], "lawnmower": [run(0, 20.0), run(1, 22.5)]}
    assert decentralisation(alone) == {}
    assert sentences(alone) == []
    assert differences(alone)["lawnmower"]["time_to_all_found_s"]["mean"] == 10.25
    both = {**alone, "maasi_joint": [run(0, 8.0, 9.0), run(1, 10.1, 9.0)]}
    cost = decentralisation(both)["maasi"]
    assert cost["time_to_all_found_s"]["mean"] == pytest.approx(1.95)
    assert cost["distance_m"]["mean"] == 1.0
    told = "\n".join(sentences(both))
    assert "maasi less maasi_joint" in told
    assert "time to all found: +1.95 ± 0.64 s\n" in told


def test_a_planner_keeps_the_keys_that_it_knows() -> None:
    mission = load(MISSION)
    joint = with_planner(mission, "maasi_joint")
    assert joint.planner == {**mission.planner, "kind": "maasi_joint"}
    assert with_planner(mission, "thompson").planner["kind"] == "thompson"
    assert "alpha" not in with_planner(mission, "lawnmower").planner
    assert with_planner(mission, "maasi") is mission


@pytest.mark.parametrize(
    ("names", "words"),
    [("masi_joint", "did you mean 'maasi_joint'"), ("maasi", "other than the mission's own"), ("", "needed")],
)
def test_planners_that_cannot_be_compared_are_told_before_anything_runs(names: str, words: str) -> None:
    with pytest.raises(MissionError, match=words):
        variants(load(MISSION), names)


def test_simulate_compares_on_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "out.json"
    arguments = ["simulate", MISSION, "--seeds", "3:5", "--duration", "4", "--json", str(file)]
    shown = CliRunner().invoke(app, [*arguments, "--compare", "maasi_joint"], catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    assert "What decentralisation costs (maasi less maasi_joint" in shown.output
    record = msgspec.json.decode(file.read_bytes())
    compared = record["compare"]
    assert compared["base"] == "maasi"
    assert [one["seed"] for one in compared["runs"]["maasi_joint"]] == [3, 4]
    assert [one["seed"] for one in record["runs"]] == [3, 4]
    sets = [
        [one["measurement_sets"] for one in some]
        for some in (record["runs"], compared["runs"]["maasi_joint"])
    ]
    assert min(map(min, sets)) > 0
    gap = compared["differences"]["maasi_joint"]["distance_m"]
    means = compared["means"]
    assert gap["mean"] == pytest.approx(
        means["maasi_joint"]["distance_m"]["mean"] - means["maasi"]["distance_m"]["mean"]
    )
    assert compared["decentralisation"]["maasi"]["distance_m"]["mean"] == pytest.approx(-gap["mean"])
    single = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "planners" not in single.output
    assert set(msgspec.json.decode(file.read_bytes())) == {"runs", "aggregate"}
