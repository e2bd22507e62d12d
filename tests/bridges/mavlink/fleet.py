"""A mission for real processes whose vehicles are simulated autopilots, served by the test itself."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bridges.mavlink.frames import TeamFrame
from sim.mavlink.serve import Served
from sim.mavlink.settings import AutopilotName, Settings

ZERO = (47.397742, 8.545594, 488.0)
STARTS = {"r1": (8.0, 8.0, 5.0), "r2": (28.0, 8.0, 8.0)}
TEAM = """
name = "copters"
seed = 5
duration_s = 28
stop_when_all_found = false
match_m = 3.0

[origin]
latitude = 47.397742
longitude = 8.545594
altitude = 488.0

[area]
min = [0, 0]
max = [50, 50]

[world]
kind = "fixed"
positions = {targets}

[filter]
kind = "smc_phd"
particles = 2000
expected_targets = 3.0

[found]
radius_m = 0.8
mass = 0.8
gate_m = 6.0

[exploration]
points = [13, 13]

[planner]
kind = "maasi"
candidates = {{ low = [8, 8], high = [44, 44], points = [4, 4] }}

[settings]
separation_m = 4.0
"""
ROBOT = """
[[robots]]
id = "{id}"
start = [{x}, {y}, {z}]
vehicle = {{ kind = "mavlink", url = "{url}", system_id = {system}, at_end = "land", take_off_m = 3.0{more} }}

[robots.sensor]
kind = "range_bearing"
period_s = 1.0
field_of_view = "box"
box_m = [[-8, 8], [-8, 8]]
range_sigma_m = 0.7
bearing_sigma_deg = 0.5
"""


def home_of(robot: str) -> tuple[float, float, float]:
    """The place on the earth above which a robot starts."""
    x, y, _ = STARTS[robot]
    import numpy as np

    return TeamFrame(ZERO).to_degrees(np.array([x, y, 0.0]))


@contextmanager
def copters(*autopilots: AutopilotName) -> Iterator[dict[str, Served]]:
    """One simulated autopilot for each robot, standing where the mission starts it."""
    with ExitStack() as stack:
        yield {
            robot: stack.enter_context(
                Served(Settings(autopilot=kind, system_id=i + 1, home=home_of(robot), ready_after=0.5))
            )
            for i, (robot, kind) in enumerate(zip(STARTS, autopilots, strict=False))
        }


def write_mission(
    directory: Path,
    fleet: dict[str, Served],
    targets: str = "[[10, 40], [45, 45]]",
    more: dict[str, str] | None = None,
) -> Path:
    """The team's mission file; `more` is added to a robot's vehicle table."""
    text = TEAM.format(targets=targets)
    for i, (robot, vehicle) in enumerate(fleet.items()):
        x, y, z = STARTS[robot]
        added = (more or {}).get(robot, "")
        text += ROBOT.format(
            id=robot, x=x, y=y, z=z, url=vehicle.url, system=i + 1, more=", " + added if added else ""
        )
    path = directory / "copters.toml"
    path.write_text(text)
    return path
