"""A link to one or several vehicles, in a thread of its own."""

# Link(url, source=(system, component), keys=None); .start(); .send(message) -> bool; .drain() -> list[Message];
# .counters -> dict[str, int]; .close(). URLs: udpin:HOST:PORT udpout:HOST:PORT tcp:HOST:PORT tcpin:HOST:PORT
# serial:DEVICE:BAUD. The same without a thread: ports.Port(...).poll(timeout) -> list[Message], .send(messages).
