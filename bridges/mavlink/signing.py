"""Signed MAVLink 2: a secret shared with the vehicle, in a file outside the mission.

A signature is the first 6 bytes of SHA-256 over secret and frame. Its time stamp, in 10 µs since 2015, must
grow on every link; the last one used is kept beside the key: after a restart with a clock that went back we
are heard all the same.
"""

import hashlib
import hmac
import time
from dataclasses import dataclass, field
from pathlib import Path

from agents.errors import DataError
from bridges.mavlink.framing import Frame

EPOCH_2015 = 1_420_070_400
TICKS = 100_000  # a second
LATE = 60 * TICKS  # a new stream may be that much behind
SAVE_EVERY = 60 * TICKS


@dataclass(slots=True)
class Keys:
    """A secret, and the time stamps seen and used with it."""

    secret: bytes  # (32,)
    link: int = 0
    file: Path | None = None  # where the last time stamp is kept
    stamp: int = 0
    _saved: int = 0
    _seen: dict[tuple[int, int, int], int] = field(default_factory=dict)

    def __repr__(self) -> str:  # never the secret
        return f"Keys(link={self.link}, streams={len(self._seen)})"

    def next_stamp(self, clock: float) -> int:
        """The time stamp of the next frame sent; `clock` is Unix seconds."""
        self.stamp = max(self.stamp + 1, int((clock - EPOCH_2015) * TICKS))
        if self.file is not None and self.stamp >= self._saved:
            self._saved = self.stamp + SAVE_EVERY
            try:
                self.file.write_text(f"{self._saved}\n")
            except OSError:
                self._saved = self.stamp + TICKS  # a read-only key directory: the clock has to be good
        return self.stamp

    def trouble(self, frame: Frame) -> str | None:
        """Why a frame is not believed: "unsigned", "signature", "replayed"; None: it is good."""
        if not frame.signed:
            return "unsigned"
        signature = hashlib.sha256(self.secret + frame.data[:-6]).digest()[:6]
        if not hmac.compare_digest(signature, frame.data[-6:]):
            return "signature"
        stamp = int.from_bytes(frame.data[-12:-6], "little")
        stream = (frame.data[-13], frame.system, frame.component)
        last = self._seen.get(stream, self.stamp - LATE)
        if stamp <= last:
            return "replayed"
        self._seen[stream] = stamp  # only after the signature: nobody else can lock a stream out
        self.stamp = max(self.stamp, stamp)
        return None


def read_keys(path: Path, link: int = 0) -> Keys:
    """The keys of a file that holds 64 hexadecimal digits, or one line `passphrase: WORDS`.

    A passphrase becomes a secret as MAVProxy, QGroundControl and Mission Planner make it: its SHA-256.

    Raises:
        DataError: if the file cannot be read, holds neither, or can be read by everybody.
    """
    try:
        text = path.read_text().strip()
        mode = path.stat().st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read the MAVLink signing key {path}: {error}") from error
    if mode & 0o077:
        raise DataError(f"everybody may read the MAVLink signing key {path}; run: chmod 600 {path}")
    words = text.removeprefix("passphrase:").strip()
    if words != text and words:
        secret = hashlib.sha256(words.encode()).digest()
    else:
        try:
            secret = bytes.fromhex(text)
        except ValueError:
            secret = b""
        if len(secret) != 32:
            raise DataError(f'{path} must hold 64 hexadecimal digits or one line "passphrase: WORDS"')
    file = path.with_name(path.name + ".time")
    try:
        stamp = int(file.read_text())
    except (OSError, ValueError):
        stamp = 0
    return Keys(secret, link, file, max(stamp, int((time.time() - EPOCH_2015) * TICKS)))
