"""Labelled targets of known number, each with a Gaussian mixture, which soft observations can change.

Ponda et al. 2012, sections II and III-C: the targets are independent (4), each is a mixture (1), and "no
detection" and operators' statements are fused one after another, (20) and (21). Added to the paper: sensors
whose measurements do not say whose they are and may be clutter (joint probabilistic data association, with
one measurement per target), and targets that move.

As an estimator.filter.Filter: the number of targets is known, so `mass` is their number whatever is seen, an
empty measurement set moves a target's density and takes nothing from it, and `remove` takes a whole target.
A target becomes a cluster, of mass 1, when its density is narrow; `labels` are its place in `targets`.
"""

from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area, Clusters
from estimator.gaussian.components import Components, moments_of, stacked
from estimator.motion import Motion
from estimator.sensor import SensorModel, checked_poses, gaussian, validated
from estimator.soft.association import shares
from estimator.soft.config import MixturesConfig
from estimator.soft.hard import conditioned, explained, undetected
from estimator.soft.importance import reweighted, turned, unit_points
from estimator.soft.priors import moving, priors
from estimator.soft.salmond import merged
from estimator.soft.statement import SoftObservation

_TRACE = 1e-5  # of a target's weight, below which a component is not worth merging


@dataclass(frozen=True, slots=True, eq=False)
class MixturesState:
    """The remaining targets after some time and some observations."""

    dimension: int  # d
    names: tuple[str, ...]  # (t,)
    labels: IntArray  # (t,) place among all targets, the named ones first
    kinds: IntArray  # (t,) targets of the same kind >= 0 cannot be told apart; -1 for a kind of its own
    mixtures: tuple[Components, ...]  # (t,) weights of sum 1
    radius: float  # metres below which a target is a cluster
    clusters: IntArray  # (c,) targets of the last `clusters` call


class Mixtures:
    """estimator.filter.Filter that also takes soft observations. Stateless but for its Config."""

    Config = MixturesConfig

    def __init__(self, config: MixturesConfig) -> None:
        """Raises ValueError if the targets' names are not unique or there are none."""
        self.config = config
        unnamed = config.unnamed if config.unnamed is not None else int(not config.targets)
        named = [target.name for target in config.targets]
        others = [name for name in (f"target {k}" for k in range(1, 1000)) if name not in named]
        self._names = (*named, *others[:unnamed])
        if len(set(named)) < len(named):
            raise ValueError("targets: names must differ")
        if not self._names:
            raise ValueError("targets: expected at least one target")

    def __repr__(self) -> str:
        return f"Mixtures({self.config})"

    def init(self, area: Area, rng: np.random.Generator) -> MixturesState:
        """Every target's prior; draws nothing.

        Raises:
            ValueError: if a target's prior does not fit the area; names the key.
        """
        d, named, count = area.dimension, len(self.config.targets), len(self._names)
        motion = Motion(d, self.config.motion)
        return MixturesState(
            dimension=d,
            names=self._names,
            labels=np.arange(count),
            kinds=np.where(np.arange(count) < named, -1, 0),
            mixtures=tuple(moving(prior, motion) for prior in priors(self.config, area, count)),
            radius=self.config.cluster_radius_m or 0.1 * float((area.high - area.low).min()),
            clusters=np.zeros(0, np.int64),
        )

    def predict(self, state: MixturesState, duration: float, rng: np.random.Generator) -> MixturesState:
        """Targets `duration` seconds later; every one survives.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        if duration == 0.0 or not state.mixtures:
            return state
        motion = Motion(state.dimension, self.config.motion)
        if motion.is_static:
            return state
        f, q = motion.transition(duration)
        return replace(
            state,
            mixtures=tuple(
                Components(m.weights, m.means @ f.T, f @ m.covariances @ f.T + q) for m in state.mixtures
            ),
        )

    def update(
        self,
        state: MixturesState,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> MixturesState:
        """(20) with a measurement set (m, s), which may be empty, of one sensor at pose (4,).

        What cannot have been is ignored: a measurement that nothing explains, and an empty set where a
        detection was certain.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite, names it; or if there are
                measurements and the sensor's noise is not Gaussian.
        """
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        if not state.mixtures:
            return state
        units = turned(unit_points(sensor.dimension, self.config.samples), rng)
        whole = stacked(state.mixtures)
        owners = np.repeat(np.arange(len(state.mixtures)), [m.count for m in state.mixtures])
        silent, sources = undetected(whole, sensor, pose, units)
        owner = owners[sources]
        missed = np.bincount(owner, silent.weights, len(state.mixtures)).astype(np.float64)
        if len(measurements) == 0:
            mixtures = [
                self._reduced(silent.chosen(owner == i)) if missed[i] > 0.0 else mixture
                for i, mixture in enumerate(state.mixtures)
            ]
            return replace(state, mixtures=tuple(mixtures))
        pairs = explained(whole, gaussian(sensor), pose, measurements)
        weights = whole.weights[pairs.components] * pairs.likelihoods
        of = owners[pairs.components]
        table = np.zeros((len(state.mixtures), len(measurements)))
        np.add.at(table, (of, pairs.measurements), weights)
        clutter = sensor.clutter_intensity(measurements, pose)
        share, unseen, kinds = shares(table, missed, clutter, state.kinds)
        scale = np.divide(share, table, out=np.zeros_like(table), where=table > 0.0)
        mixtures = []
        for i, mixture in enumerate(state.mixtures):
            factor = unseen[i] / missed[i] if missed[i] > 0.0 else 0.0
            parts = silent.chosen(owner == i).scaled(factor) if factor else mixture.scaled(unseen[i])
            mine = np.flatnonzero((of == i) & (weights > 0.0))
            seen = Components(
                weights[mine] * scale[i, pairs.measurements[mine]], pairs.means[mine], pairs.covariances[mine]
            )
            mixtures.append(self._reduced(parts.joined(seen)))
        return replace(state, mixtures=tuple(mixtures), kinds=kinds)

    def observe(
        self,
        state: MixturesState,
        statement: SoftObservation,
        rng: np.random.Generator,
        *,
        known: FloatArray | None = None,
    ) -> MixturesState:
        """(21) with an operator's statement.

        A named target is changed alone. "Nothing is near the tree" holds for every target. "Something is
        near the tree" holds for one, each as likely before: with l_i = E_i[p(statement | x_i)] it is target i
        with probability l_i / sum l, and a target's density is the mixture of what it would be if it is meant
        and what it was. (The paper cites the naive association of Ahmed et al. 2013 without equations; this
        is the exact marginal under that assumption.) Targets found before may be meant too: `known` (f,) are
        their l_i.

        Raises:
            ValueError: if the statement's target is not among those left, or its dimension is another.
        """
        if statement.target is not None and statement.target not in state.names:
            left = ", ".join(state.names) or "none"
            raise ValueError(
                f"target: expected one of those not found yet ({left}), got {statement.target!r}"
            )
        if not state.mixtures:
            return state
        d = statement.softmax.dimension
        if d != state.dimension:
            raise ValueError(f"softmax: a model in {d} dimensions does not fit the area")
        units = turned(unit_points(d, self.config.samples), rng)
        count = len(state.mixtures)
        kinds = state.kinds.copy()
        if statement.target is not None:
            which = [state.names.index(statement.target)]
            kinds[which] = -1
        else:
            which = list(range(count))
        told: dict[int, Components] = {}
        logs = np.full(count, -np.inf)
        for i in which:
            told[i], logs[i] = self._told(state.mixtures[i], statement, units)
        meant = np.ones(count)
        if statement.target is None and statement.positive:
            others = np.zeros(0) if known is None else np.log(known[known > 0.0])
            meant = np.exp(logs - np.logaddexp.reduce(np.append(logs, others)))
            for kind in np.unique(kinds[kinds >= 0]):  # of those alike, the first may as well be the one
                alike = np.flatnonzero(kinds == kind)
                meant[alike[0]] = meant[alike].sum()
                meant[alike[1:]] = 0.0
                kinds[alike[0]] = -1
        mixtures = list(state.mixtures)
        for i in which:
            sure = meant[i] * self._believed(logs[i], statement)
            if sure > 0.0:
                parts = told[i].scaled(sure).joined(mixtures[i].scaled(1.0 - sure))
                mixtures[i] = self._reduced(parts if sure < 1.0 else told[i])
        return replace(state, mixtures=tuple(mixtures), kinds=kinds)

    def clusters(self, state: MixturesState, rng: np.random.Generator) -> tuple[MixturesState, Clusters]:
        """The targets whose density is narrower than `cluster_radius_m`: (2), (3), and mass 1."""
        if not state.mixtures:
            return replace(state, clusters=np.zeros(0, np.int64)), Clusters.none(state.dimension)
        d = state.dimension
        moments = [moments_of(m) for m in state.mixtures]
        means = np.array([mean[:d] for mean, _ in moments])
        covariances = np.array([p[:d, :d] for _, p in moments])
        radii = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / d)
        narrow = np.flatnonzero(radii < state.radius)
        found = Clusters(
            np.ascontiguousarray(means[narrow].T),
            covariances[narrow],
            np.ones(narrow.size),
            radii[narrow],
            state.labels[narrow],
        )
        return replace(state, clusters=narrow), found

    def remove(self, state: MixturesState, clusters: IntArray) -> MixturesState:
        """Without the targets of the given clusters; the other clusters keep their numbers."""
        gone = state.clusters[clusters]
        kept = np.setdiff1d(np.arange(len(state.mixtures)), gone)
        number = np.full(len(state.mixtures) + 1, -1)
        number[kept] = np.arange(kept.size)
        return replace(
            state,
            names=tuple(state.names[i] for i in kept),
            labels=state.labels[kept],
            kinds=state.kinds[kept],
            mixtures=tuple(state.mixtures[i] for i in kept),
            clusters=number[state.clusters],
        )

    def mass(self, state: MixturesState) -> float:
        """How many targets are left."""
        return float(len(state.mixtures))

    def thinned(self, state: MixturesState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the sum of all densities."""
        if not state.mixtures or size < 1:
            return np.zeros((state.dimension, 0)), np.zeros(0)
        d = state.dimension
        whole = stacked(state.mixtures)
        order = np.argsort(-whole.weights, kind="stable")[:size]
        chosen = whole.chosen(order)
        each = max(1, min(size // chosen.count, 128))
        units = unit_points(d, each) if each >= 4 * d else np.zeros((d, 1))
        units = units[:, : max(each, 1)]
        lower = np.linalg.cholesky(chosen.covariances[:, :d, :d])
        points = chosen.means[:, :d, None] + lower @ units
        weights = np.repeat(chosen.weights / chosen.weights.sum(), units.shape[1]) / units.shape[1]
        flat = np.ascontiguousarray(points.transpose(1, 0, 2).reshape(d, -1))
        return flat, weights * self.mass(state)

    def _believed(self, log: float, statement: SoftObservation) -> float:
        """Probability that the statement, whose evidence has this logarithm, was meant and no error."""
        error = self.config.operator_error
        if error == 0.0:
            return 1.0
        right = (1.0 - error) * np.exp(log)
        return float(right / (right + error / statement.softmax.categories))

    def _told(
        self, mixture: Components, statement: SoftObservation, units: FloatArray
    ) -> tuple[Components, float]:
        """The mixture after a statement that is about it, and the logarithm of the statement's evidence."""
        d = len(units)
        softmax = statement.softmax
        weights, means, covariances, sources, _, log = reweighted(
            mixture.weights,
            np.ascontiguousarray(mixture.means[:, :d]),
            np.ascontiguousarray(mixture.covariances[:, :d, :d]),
            softmax.weights,
            softmax.biases,
            statement.own,
            units,
            True,
        )
        if mixture.state_size > d:
            full = [
                conditioned(mixture.means[m], mixture.covariances[m], x, p)
                for m, x, p in zip(sources, means, covariances, strict=True)
            ]
            means, covariances = np.array([x for x, _ in full]), np.array([p for _, p in full])
        return self._reduced(Components(weights, means, covariances)), log

    def _reduced(self, mixture: Components) -> Components:
        """Weights of sum 1 and at most M_max components (Salmond)."""
        weights = mixture.weights / mixture.weights.sum()
        if (kept := weights > _TRACE).sum() < weights.size:
            mixture, weights = mixture.chosen(kept), weights[kept] / weights[kept].sum()
        if weights.size <= self.config.components:
            return Components(weights, mixture.means, mixture.covariances)
        return Components(*merged(weights, mixture.means, mixture.covariances, self.config.components))
