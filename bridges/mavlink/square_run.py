"""Flies the test square in real time, and sees it down whoever interrupts."""

import signal
import time
from types import FrameType, TracebackType

import typer

from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.square import SquareFlight
from bridges.mavlink.visit import LOOK, Visit, with_options
from bridges.mavlink.wanted import Wanted

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
NEWS = 5.0  # s between words on how it comes down


class Interrupts:
    """Before anything is armed a signal ends the command; from then on it only says that it came."""

    def __init__(self) -> None:
        self.count = 0
        self.flying = False
        self._before: dict[int, object] = {}

    def __repr__(self) -> str:
        return f"Interrupts({self.count}, flying={self.flying})"

    def __enter__(self) -> "Interrupts":
        self._before = {number: signal.signal(number, self._heed) for number in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _heed(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if not self.flying:
            raise KeyboardInterrupt


def fly(visit: Visit, size: float, interrupts: Interrupts) -> int:
    """The whole flight; the exit status."""
    interrupts.flying = True
    flight = SquareFlight(size)
    heard, told, news = interrupts.count, 0, 0.0
    report = visit.look()
    while not flight.over:
        now = time.monotonic()
        report = visit.look()
        if interrupts.count > heard:
            heard = interrupts.count
            first = flight.stage != "down"
            flight.stop(now, "interrupted")
            _say("it is told to land; I stay until it is down" if first else _still(report))
        visit.bridge.want(Wanted(flight.task(now, report)))
        while told < len(flight.corners):
            corner = flight.corners[told]
            told += 1
            verdict = "reached" if corner.reached else "NOT reached"
            print(f"{corner.name:<11} {verdict}, {corner.nearest:.2f} m near, after {corner.seconds:.1f} s")
        if flight.stage == "down" and not flight.over and now - news > NEWS:
            news = now
            _say(_still(report))
        time.sleep(LOOK)
    if flight.good:
        worst = max(corner.nearest for corner in flight.corners)
        print(f"down and disarmed; every corner was reached, the worst within {worst:.2f} m")
        return 0
    _say(f"searchparty: {_end(flight, report)}")
    return 1


def _end(flight: SquareFlight, report: PilotReport) -> str:
    trouble = with_options(flight.trouble) or "it did not fly round"
    if not report.armed and report.phase != "lost":
        return f"{trouble}; it is down and disarmed"
    if report.phase == "lost":
        does = "; ".join(one.words for one in report.failsafes if one.cause in ("ground link", "setpoints"))
        return f"{trouble}; what it does now its own failsafes decide ({does}): see to it"
    return f"{trouble}; it is still armed, in mode {report.mode}: see to it"


def _still(report: PilotReport) -> str:
    height = "" if report.position is None else f", {-report.position[2]:.1f} m above its origin"
    return f"{report.phase}: {'armed' if report.armed else 'disarmed'}, mode {report.mode}{height}"


def _say(text: str) -> None:
    typer.echo(text, err=True)
