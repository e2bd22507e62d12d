"""A child process that ends when its parent is gone, even by SIGKILL, and on any POSIX system.

The parent keeps the write end of a pipe open and never writes; each child holds the read end. However the
parent ends, the system closes its end, and the child's read returns. (Linux's PR_SET_PDEATHSIG is bound to
the thread that forked, and misses a parent that dies before the call.)
"""

import os
import signal
import threading
import time
from typing import Self

VARIABLE = "SEARCHPARTY_LIFELINE_FD"
GRACE_S = 1.5  # between the polite and the impolite end


class Lifeline:
    """The parent's side. Give `read_end` to children through `pass_fds`, and `environment` too."""

    def __init__(self) -> None:
        # Neither end is inheritable by itself: only what is passed on gets the read end, and nobody
        # the write end, which would keep the children alive.
        self.read_end, self._write_end = os.pipe()
        self._open = True

    @property
    def environment(self) -> dict[str, str]:
        """What tells the child where its end is."""
        return {VARIABLE: str(self.read_end)}

    def close(self) -> None:
        """Let go: children that still run will end. Safe to call twice."""
        if self._open:
            self._open = False
            os.close(self.read_end)
            os.close(self._write_end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def start() -> bool:
    """The child's side: from now on, end this process when its parent is gone. False without a parent's pipe.

    The process gets SIGTERM, and is ended without further ado `GRACE_S` later. To be called once, early.
    """
    number = os.environ.pop(VARIABLE, None)  # a grandchild has no such descriptor
    if number is None:
        return False
    descriptor = int(number)
    os.set_inheritable(descriptor, False)
    threading.Thread(target=_wait_for_the_end, args=(descriptor,), name="lifeline", daemon=True).start()
    return True


def _wait_for_the_end(descriptor: int) -> None:
    os.read(descriptor, 1)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(1)
