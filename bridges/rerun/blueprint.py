"""How the view is laid out: the area at the left, plots at the right, events and found targets below.

The entity paths that the recording uses are named here, and nowhere else.
"""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from agents.mission.mission import Mission
from bridges.rerun.shapes import BACKGROUND, Colour, robot_colour
from estimator.arrays import FloatArray

TIMELINE = "team_time"

_VIEW_3D = np.array([0.76, -1.42, 0.64])  # from where a box is looked at, in lengths of its longest side

AREA = "world/area"
AREA_GRID = "world/area/grid"
AREA_METRES = "world/area/metres"
EXPLORATION = "world/exploration"
INTENSITY = "world/intensity"
CLUSTERS = "world/clusters"
FOUND = "world/found"
FOUND_RINGS = "world/found/rings"
FOUND_NAMES = "world/found/names"
TRUTH = "world/truth"
ROBOTS = "world/robots"
HEADINGS = "world/robots/headings"
NAMES = "world/robots/names"
TRAILS = "world/robots/trails"
TRAIL_HEADS = "world/robots/trail_heads"
VIEWS = "world/robots/views"
PLANS = "world/plans"
PLAN_MEASUREMENTS = "world/plans/measurements"
PLAN_WAYPOINTS = "world/plans/waypoints"
TARGETS_PLOT = "plots/targets"
POSTERIOR_PLOT = "plots/latency/capture_to_posterior"
LATENESS_PLOT = "plots/latency/measure_clock"
TROUBLE_PLOT = "plots/health"
STATES = "team"
EVENTS = "events"
SUMMARY = "summary"

LATENCY_RANGE_MS = 50.0

# What a robot says of itself, and how that is coloured; None is the robot's own colour.
STATE_WORDS: dict[str, Colour | None] = {
    "moving": None,
    "replaying": None,
    "planning": (250, 204, 21, 255),
    "holding": (100, 116, 139, 255),
    "gone": (220, 38, 38, 255),
}


def blueprint(mission: Mission) -> rrb.Blueprint:
    """The layout for one mission: a map seen from above in 2D, a slowly readable box in 3D."""
    area = mission.box()
    plain = rrb.archetypes.PlotBackground(color=BACKGROUND, show_grid=True)
    whole = rrb.archetypes.TimeAxis(
        view_range=rrb.TimeRange(
            start=rrb.TimeRangeBoundary.absolute(seconds=0.0), end=rrb.TimeRangeBoundary.cursor_relative()
        )
    )
    plots = rrb.Vertical(
        rrb.TimeSeriesView(
            name="Targets",
            origin=TARGETS_PLOT,
            plot_legend=rrb.PlotLegend(corner="RightBottom"),
            background=plain,
            axis_x=whole,
        ),
        rrb.TimeSeriesView(
            name="Latency (ms)",
            origin="plots/latency",
            # The first plans wait for compiled code; without a fixed range that is all one would see.
            axis_y=rrb.ScalarAxis(range=(0.0, LATENCY_RANGE_MS)),
            plot_legend=rrb.PlotLegend(corner="RightTop"),
            background=plain,
            axis_x=whole,
        ),
        rrb.TimeSeriesView(
            name="Health",
            origin=TROUBLE_PLOT,
            plot_legend=rrb.PlotLegend(corner="RightTop"),
            background=plain,
            axis_x=whole,
        ),
        rrb.StateTimelineView(name="Team", origin=STATES, time_view=whole),
        row_shares=[3, 3, 2, 3],
    )
    view = rrb.Spatial3DView(
        name=mission.description or mission.name,
        origin="world",
        background=rrb.Background(color=BACKGROUND),
        line_grid=False,  # the area brings its own, with metres on it
        eye_controls=eye(area.low, area.high),
    )
    below = rrb.Horizontal(
        rrb.TextLogView(
            name="Events",
            origin=EVENTS,
            columns=rrb.TextLogColumns(
                timeline_columns=[rrb.encodings.TimelineColumn(TIMELINE)],
                text_log_columns=["loglevel", "body"],
            ),
        ),
        rrb.TextDocumentView(name="Found", origin=SUMMARY),
        column_shares=[3, 2],
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(view, plots, column_shares=[3, 2]),
            below,
            row_shares=[10, 3],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    )


def eye(low: FloatArray, high: FloatArray) -> rrb.EyeControls3D:
    """From straight above, north up, in 2D; from the south-east, half way up, in 3D."""
    centre = (low + high) / 2.0
    size = high - low
    if low.size == 2:
        height = 1.02 * float(max(size[1], size[0]))
        return rrb.EyeControls3D(
            position=[centre[0], centre[1], height],
            look_target=[centre[0], centre[1], 0.0],
            eye_up=[0.0, 1.0, 0.0],
        )
    reach = float(max(size))
    return rrb.EyeControls3D(
        position=centre + reach * _VIEW_3D,
        look_target=centre - reach * np.array([0.0, 0.0, 0.09]),
        eye_up=[0.0, 0.0, 1.0],
    )


def log_styles(stream: rr.RecordingStream, mission: Mission) -> None:
    """Names and colours of the plots' lines; they hold for the whole recording."""
    stream.log(
        TARGETS_PLOT,
        rr.SeriesLines(
            names=["expected", "found", "true"],
            colors=[(250, 204, 21), (74, 222, 128), (148, 163, 184)],
            widths=[2.0, 3.0, 1.5],
        ),
        static=True,
    )
    stream.log(
        POSTERIOR_PLOT,
        rr.SeriesLines(
            names=["capture to posterior p50", "its p99"],
            colors=[(76, 194, 255), (37, 99, 160)],
            widths=[2.0, 1.5],
        ),
        static=True,
    )
    stream.log(
        TROUBLE_PLOT,
        rr.SeriesLines(
            names=["refused", "dropped", "lost", "not heard"],
            colors=[(248, 113, 113), (251, 191, 36), (192, 132, 252), (148, 163, 184)],
            widths=[2.0, 2.0, 2.0, 1.5],
        ),
        static=True,
    )
    for robot, colour in colours(mission).items():
        stream.log(
            f"{STATES}/{robot}",
            rr.StateConfiguration(
                values=list(STATE_WORDS),
                colors=[colour if own is None else own for own in STATE_WORDS.values()],
            ),
            static=True,
        )
    stream.log(
        LATENESS_PLOT,
        rr.SeriesLines(
            names=["measure clock late p50", "its p99 "],
            colors=[(255, 138, 101), (150, 72, 50)],
            widths=[2.0, 1.5],
        ),
        static=True,
    )


def colours(mission: Mission) -> dict[str, Colour]:
    """Each robot's own colour, by id."""
    return {robot.id: robot_colour(index) for index, robot in enumerate(mission.robots)}
