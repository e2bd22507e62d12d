"""Which processes of a computer go first."""

import contextlib
import os
from pathlib import Path


def stand_back(niceness: int) -> None:
    """Let other processes of this computer go first."""
    os.nice(niceness)
    # Linux shares the cores between sessions first, and asks for the niceness of processes only within one.
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(niceness))
