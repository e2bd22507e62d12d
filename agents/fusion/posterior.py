"""What is told of an estimate: the part that every set changes, and the large part that may wait."""

from typing import Any, TypedDict

import numpy as np

from agents.machine import Header
from agents.wire.messages import Array, PictureMessage
from estimator.arrays import FloatArray, IntArray
from estimator.search import Search, SearchState, velocities_of

PICTURE_POINTS = 1500  # of the thinned intensity


class Estimated(TypedDict):
    """Spread into the constructor of a message with an estimate."""

    expected_cardinality: float
    means: FloatArray
    covariances: FloatArray
    masses: FloatArray
    radii: FloatArray
    velocities: FloatArray
    found: FloatArray
    found_covariances: FloatArray
    found_velocities: FloatArray
    found_times: FloatArray
    found_labels: IntArray


def estimated(search: Search[Any], state: SearchState[Any]) -> Estimated:
    """Clusters and found targets of a state."""
    clusters = state.clusters
    return Estimated(
        expected_cardinality=search.expected_cardinality(state),
        means=clusters.means,
        covariances=clusters.covariances,
        masses=clusters.masses,
        radii=clusters.radii,
        velocities=velocities_of(clusters),
        found=state.found,
        found_covariances=state.found_covariances,
        found_velocities=state.found_velocities,
        found_times=state.found_times,
        found_labels=state.found_labels,
    )


def picture(search: Search[Any], state: SearchState[Any], header: Header) -> PictureMessage:
    """The exploration function, and the intensity as points."""
    points, weights = search.thinned(state, PICTURE_POINTS)
    exploration: Array = np.round(state.exploration.values * 255.0).astype(np.uint8)
    return PictureMessage(
        **header,
        exploration=exploration,
        points=points.astype(np.float32),
        weights=weights.astype(np.float32),
    )
