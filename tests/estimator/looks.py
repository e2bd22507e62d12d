"""Looks made by hand, for tests that need no sensor."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import Look


def dense_look(detection: FloatArray, likelihood: FloatArray, clutter: FloatArray) -> Look:
    """A look from p_D (n,), g (m, n) and c (m,); zeros of g are left out."""
    offsets, indices, values = [0], [], []
    for row in np.asarray(likelihood, dtype=float).reshape(len(clutter), len(detection)):
        touched = np.flatnonzero(row)
        indices += touched.tolist()
        values += row[touched].tolist()
        offsets.append(len(indices))
    return Look(
        np.asarray(detection, dtype=float),
        np.array(offsets, dtype=np.int64),
        np.array(indices, dtype=np.int64),
        np.array(values, dtype=float),
        np.asarray(clutter, dtype=float),
    )
