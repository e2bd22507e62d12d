"""A robot whose table says `ways = "mission"` has its ways flown by the autopilot itself."""

import numpy as np
import pytest

from agents.devices import VehicleState
from bridges.mavlink.kind import MavlinkConfig, MavlinkKind
from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings
from tests.bridges.mavlink.test_device import AREA, Flown, connected


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_way_is_put_on_board_flown_and_arrived_at(autopilot: str) -> None:
    with (
        Served(Settings(autopilot=autopilot, ready_after=0.2)) as served,  # type: ignore[arg-type]
        connected(served.url, ways="mission", speed_m_s=6.0) as vehicle,
    ):
        flown = Flown(vehicle)
        up = flown.until(lambda state: state.able)
        model = MavlinkKind.model(MavlinkConfig(url=served.url), AREA)
        now = flown.clock.now()
        goal = np.array([25.0, 18.0, 4.0])
        vehicle.follow(model.trajectory(up.state, goal, now, 1.0), now)
        modes = set()

        def there(state: VehicleState) -> bool:
            modes.add(served.ask(lambda pilot: pilot.mode))
            return state.arrived and bool(np.linalg.norm(state.pose[:3] - goal) < 1.0)

        state = flown.until(there)
        assert state.able
        assert {"ardupilot": "AUTO", "px4": "MISSION"}[autopilot] in modes
        items = served.ask(lambda pilot: list(pilot.plans.items[0]))
        assert len(items) == 1
        assert items[0].command == 16
        vehicle.detour(np.array([20.0, 10.0, 4.0]), flown.clock.now())  # keeping apart is flown by setpoints
        flown.until(lambda state: bool(np.linalg.norm(state.pose[:3] - [20.0, 10.0, 4.0]) < 1.0))
        assert served.ask(lambda pilot: pilot.mode) in ("GUIDED", "OFFBOARD")
        assert vehicle.leave() in (True, False)
        flown.until(lambda state: vehicle.leave())
        assert served.ask(lambda pilot: pilot.mode) == "RTL"
