"""A tool's visit to one vehicle: found or told why not, asked, listened to, and never left in the air.

Every trouble becomes one sentence that says what to do, raised as a LinkError.
"""

import time
from collections.abc import Callable
from types import TracebackType

from agents.errors import LinkError
from bridges.mavlink.bridge import Bridge
from bridges.mavlink.mission_items import Item, PlanKind
from bridges.mavlink.mission_protocol import Conversation, Download, keeps_home_first
from bridges.mavlink.pilot import Errand
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.rates import RateMeter
from bridges.mavlink.signing import Keys

LOOK = 0.02  # s
LISTEN = 3.5  # s in which a second vehicle of the same id, or one that is no more, shows
ERRAND_PATIENCE = 60.0
OPENING = {
    "tcp": "; start the vehicle or its router there, or correct the address",
    "serial": "; is it plugged in, and are you in the group that may use it (dialout)?",
    "udpin": "; does another program listen on this port already?",
    "tcpin": "; does another program listen on this port already?",
}


class Visit:
    """Use as a context. `say(level, text)` gets what people should read meanwhile."""

    def __init__(
        self,
        url: str,
        config: PilotConfig,
        keys: Keys | None,
        patience: float,
        say: Callable[[str, str], None],
    ) -> None:
        """
        Raises:
            MissionError: if the URL is none.
        """
        self.url = url
        self.bridge = Bridge(url, config, keys)
        self._config = config
        self._patience = patience
        self._say = say

    def __repr__(self) -> str:
        return f"Visit({self.bridge!r})"

    def __enter__(self) -> "Visit":
        self.bridge.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bridge.close()

    def look(self) -> PilotReport:
        """The newest report; tells what has happened."""
        report = self.bridge.report()
        told_otherwise = {f"{one.cause}: {one.words}" for one in report.failsafes}
        for event in self.bridge.events():
            if event.text not in told_otherwise and not (
                report.phase == "refused" and event.text == report.trouble
            ):
                self._say(event.level, event.text)
        return report

    def meet(self) -> PilotReport:
        """Wait until the vehicle has said what it is and does by itself.

        Raises:
            LinkError: if it does not in time, or may not be flown by us.
        """
        end = time.monotonic() + self._patience
        while True:
            report = self._checked()
            if report.phase not in ("connecting", "introducing"):
                return report
            if time.monotonic() > end:
                raise LinkError(self._absent(report))
            time.sleep(LOOK)

    def listen(self, seconds: float | None = None) -> tuple[PilotReport, dict[str, float]]:
        """What comes in so many seconds, in Hz, and the report after them.

        Raises:
            LinkError: if it is not there any more, or was not alone.
        """
        meter = RateMeter(LISTEN if seconds is None else seconds)
        self.run(meter, "listening")
        return self._checked(), meter.rates()

    def run(self, errand: Errand, what: str) -> None:
        """Wait for an errand.

        Raises:
            LinkError: if the vehicle is lost meanwhile, or the errand fails.
        """
        self.bridge.run(errand)
        end = time.monotonic() + ERRAND_PATIENCE
        while not errand.done:
            self._checked()
            if time.monotonic() > end:
                raise LinkError(
                    f"{what} took more than {ERRAND_PATIENCE:g} s; try again nearer to the vehicle"
                )
            time.sleep(LOOK)
        if isinstance(errand, Conversation) and errand.trouble:
            raise LinkError(errand.trouble)

    def download(self, kind: PlanKind) -> list[Item]:
        """What is on board.

        Raises:
            LinkError: if it cannot be read.
        """
        report = self.bridge.report()
        errand = Download(kind, *self.addresses(report), keeps_home_first(report.autopilot))
        self.run(errand, f"the download of the {kind.word}")
        return errand.items

    def addresses(self, report: PilotReport) -> tuple[tuple[int, int], tuple[int, int]]:
        """System and component id of the vehicle, and of us."""
        system = report.system or 1
        return (system, 1), (self._config.source_system or system, self._config.source_component)

    def _checked(self) -> PilotReport:
        report = self.look()
        if report.phase in ("refused", "failed"):
            raise LinkError(with_options(report.trouble))
        if report.phase == "lost":
            raise LinkError(f"{report.trouble}; see to its power and the link to {self.url}")
        return report

    def _absent(self, report: PilotReport) -> str:
        counts = dict(report.counters or {})
        if report.phase == "connecting":
            garbage = counts.get("garbage_bytes", 0)
            if garbage and not report.link.version1 and not counts.get("received"):
                return (
                    f"{garbage} bytes came from {self.url}, but no MAVLink frame is among them; "
                    "is it another protocol, or is the baud rate wrong?"
                )
            hint = "" if report.link.open else OPENING.get(self.url.partition(":")[0], "")
            return with_options(report.trouble) + hint
        system = report.system
        if report.capabilities is None:
            return (
                f"system {system} is heard at {self.url}, but it answers nothing in {self._patience:g} s; do "
                "our messages reach it (a port that only sends, a firewall, a radio out of reach)?"
            )
        return (
            f"system {system} has not told its failsafes within {self._patience:g} s; try a longer --patience"
        )


def with_options(text: str) -> str:
    """A sentence of the bridge's, with the options that a person can type."""
    return (
        text.replace("system_id", "--system-id")
        .replace("name the key file", "name the key file with --keys")
        .replace("the mission expects", "you expect")
    )
