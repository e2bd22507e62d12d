"""Where a vehicle is to be found: `udpin:0.0.0.0:14550`, `tcp:HOST:5760`, `serial:/dev/ttyACM0:115200`."""

from dataclasses import dataclass

from agents.errors import MissionError

KINDS = ("udpin", "udpout", "tcp", "tcpin", "serial")
EXAMPLES = (
    "udpin:0.0.0.0:14550, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:/dev/ttyACM0:115200"
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One end of a link. For a serial line `host` is the device and `port` the baud rate."""

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


def parse_url(text: str) -> Endpoint:
    """An endpoint as pymavlink and MAVProxy write it.

    Raises:
        MissionError: if it is none.
    """
    kind, _, rest = text.partition(":")
    host, _, number = rest.rpartition(":")
    if kind not in KINDS or not host:
        raise MissionError(f'"{text}" is no MAVLink address; expected {EXAMPLES}')
    if not number.isdecimal() or not 0 < int(number) < (2**32 if kind == "serial" else 2**16):
        what = "baud rate" if kind == "serial" else "port"
        raise MissionError(f'"{text}": "{number}" is no {what}; expected {EXAMPLES}')
    return Endpoint(kind, host.strip("[]"), int(number))
