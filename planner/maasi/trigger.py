"""Event-triggered measurements: whether a look from here promises to tell something."""

import numpy as np

from estimator.arrays import FloatArray
from estimator.exploration import Exploration
from estimator.sensor import SensorModel


def worth_measuring(
    sensor: SensorModel,
    clusters: FloatArray,
    exploration: Exploration,
    pose: FloatArray,
    gamma: float,
    threshold: float,
) -> bool:
    """Whether (24), (33) of (MA)ASI holds: sum_c p_D(nu_c; q) + gamma e(q) > T_delta.

    Args:
        clusters: centres nu_c (d, c) of the estimated targets that are not yet found.
        pose: q (4,), where the measurement would be taken.
        gamma, threshold: the rule's parameters.
    """
    refinement = float(sensor.detection(clusters, pose[None, :]).sum()) if clusters.shape[1] else 0.0
    here = np.ascontiguousarray(pose[: sensor.dimension, None])
    return refinement + gamma * float(exploration.at(here)[0]) > threshold
