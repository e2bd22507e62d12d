"""The one way this project compiles a numeric kernel."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

# NaN and infinity keep their meaning: the bad-input checks depend on them.
_FAST = {"contract", "reassoc", "arcp", "nsz"}


def kernel(function: F) -> F:
    """Compile at first call, release the GIL, keep the machine code on disk for the next process."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath=_FAST, error_model="numpy")(function))
