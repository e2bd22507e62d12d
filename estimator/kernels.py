"""The one way this project compiles a numeric kernel."""

import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

if "scipy.linalg" not in sys.modules:
    # With the first kernel numba asks whether scipy.linalg is there, by importing it. Its answer only says
    # whether np.cov may be compiled; each process would pay for it with 13 MB and 0.15 s.
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath
    finally:
        del sys.modules["scipy.linalg"]

F = TypeVar("F", bound=Callable[..., Any])

# NaN and infinity keep their meaning: the bad-input checks depend on them.
_FAST = {"contract", "reassoc", "arcp", "nsz"}


def kernel(function: F) -> F:
    """Compile at first call, release the GIL, keep the machine code on disk for the next process."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath=_FAST, error_model="numpy")(function))


def exact_kernel(function: F) -> F:
    """As `kernel`, but in the order of operations as written.

    For code that must give the same bits however its loop is cut or compiled, such as a vehicle's motion:
    fast mathematics would let the compiler add up differently in an unrolled loop than in its remainder.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


@kernel
def exp_negative(x: float) -> float:
    """exp(x) for x <= 0, to a relative 1e-11 above x = -100; loops of it become vector instructions.

    The library's exp stops the compiler from doing several at a time. exp(x) = exp(x / 1024)^1024 with a
    Taylor polynomial inside. Below x = -700 the value of -700 is given: next to nothing, still positive.
    """
    y = (-700.0 if x < -700.0 else x) * (1.0 / 1024.0)
    p = 1.0 + y * (1.0 / 8.0)
    p = 1.0 + y * (1.0 / 7.0) * p
    p = 1.0 + y * (1.0 / 6.0) * p
    p = 1.0 + y * (1.0 / 5.0) * p
    p = 1.0 + y * (1.0 / 4.0) * p
    p = 1.0 + y * (1.0 / 3.0) * p
    p = 1.0 + y * (1.0 / 2.0) * p
    p = 1.0 + y * p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p
