"""Every random draw of a run comes from a generator made here."""

import zlib

import numpy as np


def generator(seed: int, *purpose: str | int) -> np.random.Generator:
    """An independent generator for (mission seed, role, id, purpose, ...), the same on every machine."""
    words = [seed & 0xFFFFFFFF, seed >> 32]
    words += [zlib.crc32(part.encode()) if isinstance(part, str) else part & 0xFFFFFFFF for part in purpose]
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(words)))
