# SPDX-License-Identifier: BSD-3-Clause
"""Where each thing stands in a rerun recording (its entity path), and how the window is laid out when it opens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from impedance_modules.episode.view_scene import Scene

APPLICATION = "impedance_modules"
TIMELINE = "time"
WORLD = "/world"
TANK = "/energy/tank"
ACTIVE_ROWS = "/safety/active_rows"
PHASE = "/task/phase"
LOG = "/task/log"
POSITION_ERROR = "/tracking/position_mm"
ANGLE_ERROR = "/tracking/angle_deg"


def run_layout(scene: Scene) -> rrb.Blueprint:
    """Returns the layout of a run: 3D, phases and log; tank, torque over limit, tracking, forces, QP rows."""
    world = rrb.Spatial3DView(
        origin=WORLD,
        name="arms, springs, wrenches",
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.25),
        eye_controls=rrb.EyeControls3D(position=(1.9, 0.9, 0.9), look_target=(0.4, 0.0, 0.15)),
        background=(28, 31, 36, 255),
    )
    phases = rrb.StateTimelineView(origin=PHASE, name="phase")
    log = rrb.TextLogView(origin=LOG, name="what happened")
    left = rrb.Vertical(world, phases, log, row_shares=[7, 1, 2])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*_curves(scene)), column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def columns_layout(groups: Mapping[str, Sequence[str]], *, with_phases: bool) -> rrb.Blueprint:
    """Returns the layout of a log without a task: one plot per quantity, and nothing that was not recorded.

    Args:
        groups: Title of a plot -> its
        with_phases: The log names its phases.
    """
    views = [_plot(title, paths, None) for title, paths in groups.items()]
    if with_phases:
        views.append(rrb.StateTimelineView(origin=PHASE, name="phase"))
    return rrb.Blueprint(
        rrb.Grid(*views, grid_columns=2),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def entity(*parts: str) -> str:
    """Returns an entity path; a slash inside a name makes a level, other signs are escaped."""
    names = [name for part in parts for name in part.split("/") if name]
    return "/" + "/".join(rr.escape_entity_path_part(name) for name in names)


def body_path(role: str, name: str) -> str:
    """Returns the path of a body; its shapes lie below it."""
    return entity("world", role, name)


def spring_path(name: str) -> str:
    """Returns the path of a spring's line."""
    return entity("world", "springs", name)


def wrench_path(name: str) -> str:
    """Returns the path of a wrench's arrows."""
    return entity("world", "wrenches", name)


def ellipsoid_path(name: str) -> str:
    """Returns the path of an ellipsoid."""
    return entity("world", "ellipsoids", name)


def torque_path(limb: str) -> str:
    """Returns the path of a limb's torque over limit."""
    return entity("torque", limb)


def force_path(name: str) -> str:
    """Returns the path of the curves of a wrench's force."""
    return entity("force", name)


def column_path(kind: str, name: str) -> str:
    """Returns the path of curves taken straight from an episode's columns."""
    return entity("episode", kind, name)


def _curves(scene: Scene) -> list[Any]:
    top = 1.05 * scene.tank_max
    views = [_plot("tank [J]: level, floor, max", [TANK], (0.0, top))]
    torques = [_plot(f"torque / limit, {limb}", [torque_path(limb)], (-1.1, 1.1)) for limb in scene.limbs]
    views += [_tabs(torques)] if torques else []
    if scene.tracked:
        views.append(
            _tabs(
                [
                    _plot("distance to target [mm]", [POSITION_ERROR], None),
                    _plot("angle to target [deg]", [ANGLE_ERROR], None),
                ]
            )
        )
    forces = [_plot(f"force [N], {name}", [force_path(name)], None) for name in scene.wrenches]
    views += [_tabs(forces)] if forces else []
    if scene.constraints:
        views.append(_plot("active QP rows", [ACTIVE_ROWS], None))
    return views


def _plot(title: str, paths: Sequence[str], limits: tuple[float, float] | None) -> Any:
    axis = None if limits is None else rrb.ScalarAxis(range=limits)
    return rrb.TimeSeriesView(
        origin="/",
        contents=list(paths),
        name=title,
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=axis,
        plot_legend=rrb.PlotLegend(visible=True),
    )


def _tabs(views: Sequence[Any]) -> Any:
    return views[0] if len(views) == 1 else rrb.Tabs(*views)
