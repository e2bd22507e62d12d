"""The still half of the picture: area, unexplored space, intensity, clusters, found and true targets."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import rerun as rr

from agents.mission.mission import Mission
from agents.wire import messages as m
from bridges.rerun import blueprint as paths
from bridges.rerun import shapes
from bridges.rerun.plots import summary_text
from estimator.arrays import FloatArray

_MOST_UNEXPLORED = 3000  # points; more is a fog that hides what is in it


class Scene:
    """Draws onto one stream, as a flat map in 2D and as a box in 3D."""

    def __init__(self, mission: Mission, stream: rr.RecordingStream) -> None:
        self.mission = mission
        self.dimension = len(mission.area.min)
        self._area = mission.box()
        self.size = float((self._area.high - self._area.low).max())  # metres
        self.shading: Literal["flat", "gradient"] = "flat" if self.dimension == 2 else "gradient"
        self._stream = stream
        self._drawn_exploration: m.Array | None = None

    def __repr__(self) -> str:
        return f"Scene({self.mission.name}, {self.dimension}D)"

    def place(self, pose: m.Array) -> FloatArray:
        """Where a pose is drawn: a map is flat."""
        return np.array([pose[0], pose[1], pose[2] if self.dimension == 3 else self.layer(6)])

    def layer(self, number: int) -> float:
        """The height of a layer of a map, metres; in space nothing is lifted."""
        return 1e-3 * self.size * number if self.dimension == 2 else 0.0

    def names(
        self, places: FloatArray, labels: list[str], colours: Sequence[shapes.Colour] | shapes.Colour
    ) -> rr.Points3D:
        """Labels beside what they name; on the point itself they would cover it."""
        aside = np.array([0.0, -0.012, 0.0]) if self.dimension == 2 else np.array([0.0, 0.0, -0.02])
        return rr.Points3D(
            places + self.size * aside, radii=-0.01, colors=colours, labels=labels, show_labels=True
        )

    def draw_area(self) -> None:
        """Once: the borders and a grid with its metres."""
        low, high = self._area.low, self._area.high
        lines, spacing = shapes.area_lines(low, high, float(low[2]) if self.dimension == 3 else self.layer(1))
        edges = shapes.box_edges(low, high)
        log = self._stream.log
        log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log(paths.AREA, rr.LineStrips3D(edges, radii=-1.0, colors=shapes.BORDER), static=True)
        log(paths.AREA_GRID, rr.LineStrips3D(lines, radii=-0.5, colors=shapes.GRID), static=True)
        corner = np.array([[*(low[:2] + self.size * np.array([0.045, 0.03])), edges[0][0, 2]]])
        label = f"grid {spacing:g} m"
        log(
            paths.AREA_METRES,
            rr.Points3D(corner, radii=-0.1, colors=shapes.BORDER, labels=[label], show_labels=True),
            static=True,
        )

    def draw_picture(self, picture: m.PictureMessage) -> None:
        """The exploration function, if it changed, and the thinned intensity."""
        log = self._stream.log
        low, high = self._area.low, self._area.high
        values = picture.exploration
        if self._drawn_exploration is None or not np.array_equal(values, self._drawn_exploration):
            self._drawn_exploration = values
            if self.dimension == 2:
                image = shapes.exploration_image(values, high - low)
                log(
                    paths.EXPLORATION,
                    rr.GridMap(
                        data=image.tobytes(),
                        format=rr.components.ImageFormat(
                            width=image.shape[1],
                            height=image.shape[0],
                            color_model="RGB",
                            channel_datatype="U8",
                        ),
                        cell_size=float((high - low)[0]) / image.shape[1],
                        translation=[low[0], low[1], 0.0],
                    ),
                )
            else:
                fog = shapes.unexplored_points(values, low, high, _MOST_UNEXPLORED)
                log(paths.EXPLORATION, rr.Points3D(fog, radii=-0.9, colors=shapes.UNEXPLORED))
        if picture.points.shape[1] == 0:
            log(paths.INTENSITY, rr.Points3D([]))
            return
        heat = np.cbrt(np.minimum(shapes.local_mass(picture.points, picture.weights, low, high), 1.0))
        log(
            paths.INTENSITY,
            rr.Points3D(
                shapes.lifted(picture.points, self.layer(2)),
                radii=-(1.0 + 1.8 * heat),
                colors=shapes.fire(heat),
            ),
        )

    def draw_posterior(
        self, posterior: m.EstimateMessage | None, truth: m.TruthMessage | None, now: float
    ) -> None:
        """Clusters, found targets and, where it is known, the truth; their plot and their list."""
        log = self._stream.log
        if truth is not None:
            marks = shapes.crosses(
                shapes.lifted(truth.targets, self.layer(3)), 0.011 * self.size, self.dimension
            )
            log(paths.TRUTH, rr.LineStrips3D(marks, radii=-0.8, colors=shapes.TRUTH))
        total = None if truth is None else truth.targets.shape[1]
        if posterior is None:
            return
        self._draw_clusters(posterior)
        places = shapes.lifted(posterior.found, self.layer(7))
        named = zip(posterior.found_labels, posterior.found_times, strict=True)
        labels = [f"{label + 1} · {time:.0f} s" for label, time in named]
        radius = -2.5 if self.dimension == 2 else -5.0
        log(paths.FOUND, rr.Points3D(places, radii=radius, colors=shapes.FOUND, point_shading=self.shading))
        log(paths.FOUND_NAMES, self.names(places, labels, shapes.FOUND))
        found_rings = shapes.rings(places, 0.017 * self.size)
        log(paths.FOUND_RINGS, rr.LineStrips3D(found_rings, radii=-1.2, colors=shapes.FOUND))
        curve = [posterior.expected_cardinality, float(posterior.found.shape[1])]
        log(paths.TARGETS_PLOT, rr.Scalars([*curve, float("nan") if total is None else float(total)]))
        text = summary_text(self.mission, posterior, total, now)
        log(paths.SUMMARY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _draw_clusters(self, posterior: m.EstimateMessage) -> None:
        log = self._stream.log
        if self.dimension == 2:
            curves = [
                shapes.ellipse(mean, covariance, self.layer(4))
                for mean, covariance in zip(posterior.means.T, posterior.covariances, strict=True)
            ]
            log(paths.CLUSTERS, rr.LineStrips3D(curves, radii=-0.9, colors=shapes.CLUSTER))
            return
        bodies = [shapes.ellipsoid(covariance) for covariance in posterior.covariances]
        log(
            paths.CLUSTERS,
            rr.Ellipsoids3D(
                centers=posterior.means.T,
                half_sizes=[half for half, _ in bodies],
                quaternions=[quaternion for _, quaternion in bodies],
                colors=shapes.CLUSTER,
                line_radii=-0.4,
                fill_mode="majorwireframe",
            ),
        )
