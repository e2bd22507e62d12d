"""Bytes into frames of MAVLink 1 and 2, whatever else is among the bytes.

A frame is taken only with a good checksum, and after a bad one the search goes on behind its first byte, so
that a stray marker in garbage does not swallow the good frames after it (pymavlink's parser skips them).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from pymavlink.generator.mavcrc import x25crc

from bridges.mavlink.dialect import mavlink

V1, V2 = 0xFE, 0xFD
SIGNED = 0x01
SIGNATURE = 13


@dataclass(frozen=True, slots=True)
class Frame:
    """One whole frame with a good checksum; that of an unknown message nobody can check."""

    data: bytes
    version: int
    signed: bool
    sequence: int
    system: int
    component: int
    message: int


class Framer:
    """Cuts one stream (or the datagrams of one peer) into frames."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.garbage = 0  # bytes that belonged to no frame
        self.broken = 0  # frames with a bad checksum
        self.unknown = 0  # frames of messages that are not in the dialect

    def __repr__(self) -> str:
        return f"Framer(garbage={self.garbage}, broken={self.broken}, unknown={self.unknown})"

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that are complete with `data`."""
        buffer = self._buffer
        buffer += data
        start, end = 0, len(buffer)
        while start < end:
            marker = buffer[start]
            if marker not in (V1, V2):
                start += 1
                self.garbage += 1
                continue
            header = 10 if marker == V2 else 6
            if end - start < 3:
                break
            flags = buffer[start + 2] if marker == V2 else 0
            if flags & ~SIGNED:
                start += 1
                self.garbage += 1
                continue
            length = header + buffer[start + 1] + 2 + (SIGNATURE if flags else 0)
            if end - start < length:
                break
            frame = _checked(bytes(buffer[start : start + length]), marker, header)
            if frame is None:
                self.broken += 1
                self.garbage += 1
                start += 1
                continue
            start += length
            self.unknown += frame.message not in mavlink.mavlink_map
            yield frame
        del buffer[:start]

    def end(self) -> None:
        """The datagram or the stream ends here: what is half read stays so."""
        self.garbage += len(self._buffer)
        self._buffer.clear()


def _checked(data: bytes, marker: int, header: int) -> Frame | None:
    if marker == V2:
        sequence, system, component = data[4], data[5], data[6]
        message, signed = int.from_bytes(data[7:10], "little"), bool(data[2] & SIGNED)
    else:
        sequence, system, component, message = data[2], data[3], data[4], data[5]
        signed = False
    frame = Frame(data, 2 if marker == V2 else 1, signed, sequence, system, component, message)
    kind = mavlink.mavlink_map.get(message)
    if kind is None:
        return frame  # nobody can check it: its checksum needs the message's definition
    end = header + data[1]
    crc = x25crc(data[1:end] + bytes([kind.crc_extra])).crc
    return frame if crc == int.from_bytes(data[end : end + 2], "little") else None
