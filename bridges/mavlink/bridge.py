"""One vehicle's bridge: a thread between a link and the pilot that never blocks the robot.

The robot leaves its wish and takes a snapshot; neither waits for the link. The thread lives in the robot's
process and dies with it: setpoints stop then, and the autopilot does what `PilotReport.failsafes` says. A
robot whose loop hangs is noticed here, because it does not look after its vehicle any more.
"""

import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.event import Event
from bridges.mavlink.pilot import Errand, Pilot
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.pilot_report import PilotReport, report_of
from bridges.mavlink.port import Port
from bridges.mavlink.signing import Keys
from bridges.mavlink.wanted import Wanted

SWITCH = 0.001  # s
TICK = 0.05  # s between the pilot's steps when nothing comes
HEARD_BY_ID = frozenset(
    {
        *(
            mavlink.MAVLINK_MSG_ID_HEARTBEAT,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        ),
        *(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT),
        *(
            mavlink.MAVLINK_MSG_ID_ATTITUDE,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        ),
        *(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS),
        *(mavlink.MAVLINK_MSG_ID_HOME_POSITION, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
        *(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
        *(
            mavlink.MAVLINK_MSG_ID_RADIO_STATUS,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT,
            mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        ),
        *(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, mavlink.MAVLINK_MSG_ID_TIMESYNC),
        *(mavlink.MAVLINK_MSG_ID_MISSION_REQUEST, mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT),
        *(mavlink.MAVLINK_MSG_ID_MISSION_ACK, mavlink.MAVLINK_MSG_ID_MISSION_COUNT),
        *(mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT),
        *(mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED, mavlink.MAVLINK_MSG_ID_LANDING_TARGET),
        mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS,
    }
)


class Bridge:
    """Flies one vehicle from its own thread."""

    def __init__(
        self,
        url: str,
        config: PilotConfig,
        keys: Keys | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._pilot = Pilot(config)
        self._port = Port(url, self._pilot.us, keys, self._heed, clock)
        self._clock = clock
        self._wanted = Wanted()
        self._looked = clock()
        self._report = PilotReport(clock())
        self._events: deque[Event] = deque(maxlen=200)
        self._errands: deque[Errand] = deque()
        self._resume = False
        self._ending = False
        self._thread = threading.Thread(target=self._run, name=f"mavlink {url}", daemon=True)

    def __repr__(self) -> str:
        return f"Bridge({self._pilot!r}, {self._port!r})"

    def __enter__(self) -> "Bridge":
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self) -> None:
        """Begin to look for the vehicle."""
        self._looked = self._clock()
        # A thread that computes lets go of the interpreter every 5 ms by default: too late for setpoints.
        sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH))
        self._thread.start()

    def want(self, wanted: Wanted) -> None:
        """Leave what the robot wants; on the link within a few milliseconds."""
        self._looked = self._clock()
        self._wanted = wanted
        self._port.wake()

    def report(self) -> PilotReport:
        """The newest snapshot. Asking for it is what shows that the robot is alive."""
        self._looked = self._clock()
        return self._report

    def events(self) -> list[Event]:
        """What people should read, each once."""
        found = []
        while self._events:
            found.append(self._events.popleft())
        return found

    def run(self, errand: Errand) -> None:
        """Begin a conversation beside flying."""
        self._errands.append(errand)
        self._port.wake()

    def resume(self) -> None:
        """Fly on after a take-over, a lasting fallback or too many refusals: a person's explicit act."""
        self._resume = True
        self._port.wake()

    def close(self) -> None:
        """End the thread. The vehicle is left as it is: land or return it first."""
        self._ending = True
        self._port.wake()
        if self._thread.is_alive():
            self._thread.join(3.0)

    def _heed(self, system: int, component: int, message: int) -> bool:
        return message == 0 or (system == self._pilot.identity.system and message in HEARD_BY_ID)

    def _run(self) -> None:
        try:
            while not self._ending:
                self._step(self._port.poll(TICK))
        except Exception as error:  # a defect: setpoints stop, the autopilot decides, and the robot is told
            text = f"the bridge has failed and flies no more: {error!r}"
            self._events.append(Event(self._clock(), "error", text))
            self._report = replace(self._report, phase="failed", trouble=text, ours=False)
        finally:
            self._port.close()

    def _step(self, received: list[object]) -> None:
        now, pilot = self._clock(), self._pilot
        if self._resume:
            self._resume = False
            pilot.resume(now)
        while self._errands:
            pilot.run(self._errands.popleft())
        out = pilot.step(now, received, self._wanted, now - self._looked, self._port.state())
        self._port.wire.source = pilot.us
        self._port.send(out)
        if pilot.events:
            self._events.extend(pilot.events)
            pilot.events.clear()
        self._report = report_of(now, pilot, self._port.counters)
