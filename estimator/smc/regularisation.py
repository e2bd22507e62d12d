"""Resampling of the particle filter's state, and the noise that keeps its particles from running out."""

from dataclasses import replace

import numpy as np

from estimator.arrays import FloatArray
from estimator.smc.config import SmcPhdConfig
from estimator.smc.resampling import effective_size, effective_sizes, gathered, jittered, systematic
from estimator.smc.state import SmcPhdState

REACH = 3.0  # standard deviations of a measurement's location that a cluster reaches by default


def is_due(state: SmcPhdState, config: SmcPhdConfig) -> bool:
    """Whether there are too many particles, or too few of them have the weight."""
    n = state.weights.size
    if n > config.particles:
        return True
    share = config.resample_below
    return share > 0.0 and not effective_size(state.weights) >= share * n


def resampled(state: SmcPhdState, config: SmcPhdConfig, rng: np.random.Generator) -> SmcPhdState:
    """The same intensity in equal weights and other places: systematic, then jitter within clusters, then
    roughening of copies (Gordon, Salmond & Smith 1993), which also reaches what is in no cluster.

    A quarter of `particles` per expected target, at most `particles`.
    """
    mass = float(state.weights.sum())
    if mass <= 0.0:
        none = np.zeros(0, dtype=np.int64)
        return replace(state, states=state.states[:, :0].copy(), weights=np.zeros(0), labels=none)
    count = int(np.clip(np.ceil(0.25 * config.particles * mass), 100, config.particles))
    chosen = systematic(state.weights, count, rng.random())
    states, labels = gathered(state.states, chosen), state.labels[chosen]
    if config.jitter > 0.0 and state.centres.shape[1]:
        clusters = int(state.labels.max(initial=-1)) + 1
        effective = effective_sizes(state.weights, state.labels, clusters)
        noise = rng.standard_normal(states.shape)
        low, high = _limits(state)
        jittered(states, labels, effective, config.jitter, noise, low, high)
    if config.roughening > 0.0:
        step = config.roughening * state.reach / REACH
        copies = np.append(False, chosen[1:] == chosen[:-1])
        d = state.centres.shape[0]
        states[:d] += step * copies * rng.standard_normal((d, count))
    return replace(state, states=states, weights=np.full(count, mass / count), labels=labels)


def _limits(state: SmcPhdState) -> tuple[FloatArray, FloatArray]:
    """The area, and any velocity."""
    area, free = state.undetected.area, state.states.shape[0] - state.centres.shape[0]
    if free == 0:
        return area.low, area.high
    any_velocity = np.full(free, np.inf)
    return np.append(area.low, -any_velocity), np.append(area.high, any_velocity)
