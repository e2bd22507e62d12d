"""Filters' states as beliefs, and beliefs as filters' states."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from estimator.averaging.attention import Attention
from estimator.averaging.belief import Belief
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhdState
from estimator.lmb.lmb import LmbState
from estimator.smc.state import SmcPhdState

S = TypeVar("S", SmcPhdState, GmPhdState)


def belief_of(state: SmcPhdState | GmPhdState | LmbState, attention: Attention) -> Belief:
    """The state's intensity, with what its robot has looked at.

    An LMB state gives the intensity of its tracks, sum r_i p_i(x); identities are its robot's own and stay.

    Raises:
        ValueError: if it is another filter's state.
    """
    if isinstance(state, SmcPhdState):
        return Belief(state.weights, np.ascontiguousarray(state.states.T), None, state.undetected, attention)
    if isinstance(state, GmPhdState):
        parts = state.components
    elif isinstance(state, LmbState):
        tracks = state.tracks
        parts = tracks.components.scaled(tracks.existence[tracks.owners()])
    else:
        raise ValueError(f"state: of particles, Gaussian mixture or LMB expected, got {type(state).__name__}")
    return Belief(parts.weights, parts.means, parts.covariances, state.undetected, attention)


def state_with(state: S, belief: Belief) -> S:
    """The filter's state with the intensity of a belief, for the filter to go on with.

    Not for LMB states: an intensity does not say which target is which.

    Raises:
        ValueError: if the belief has not the form of the state's filter.
    """
    labels = np.full(belief.weights.size, -1)
    if isinstance(state, SmcPhdState):
        if belief.covariances is not None:
            raise ValueError("belief: weighted points expected for a particle filter, got Gaussians")
        states = np.ascontiguousarray(belief.means.T)
        return replace(
            state, states=states, weights=belief.weights, labels=labels, undetected=belief.undetected
        )
    if belief.covariances is None:
        raise ValueError("belief: Gaussians expected for a Gaussian-mixture filter, got points")
    parts = Components(belief.weights, belief.means, belief.covariances)
    return replace(state, components=parts, labels=labels, undetected=belief.undetected)
