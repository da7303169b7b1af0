# SPDX-License-Identifier: BSD-3-Clause
"""One still picture of a run, for reports and for people without a viewer; a panel draws one quantity."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure

from impedance_modules.episode.columns import HINGE, HINGE_COLUMNS
from impedance_modules.episode.data import Episode, Vector
from impedance_modules.episode.run_folder import whole_file
from impedance_modules.episode.view_scene import LIMIT, css, series_colour
from impedance_modules.plain_figures import plain_figure

PICTURE_KINDS: tuple[str, ...] = (
    "position",
    "effort_command",
    "effort",
    "wrench",
    "pose",
    "target",
    "tank",
    "phase",
    HINGE,
)
"""What a picture can show; ``read_episode(path, PICTURE_KINDS)`` spares the memory of the rest."""

WIDTH = 13.0
PANEL_HEIGHT = 1.9

RESOLUTION = 130
"""Dots per inch."""

MOST_POINTS = 4000
"""Of a curve that are drawn: more than a picture can show."""

PLANES: tuple[tuple[str, int, int], ...] = (("from above", 1, 0), ("from behind", 1, 2))
AXIS_NAMES = "xyz"

MOST_LABELS = 9
"""Curves that a legend beside a panel has room for."""

AnyFigure = Figure | SubFigure
TimePanel = Callable[[Axes, Episode, slice], None]


def write_picture(episode: Episode, path: Path) -> Path:
    """Draws hand paths against targets, force, tank and torque over limit, with the phases shaded.

    What was not recorded has no panel. Torque is drawn over its limit where the metadata has ``effort_max``,
    by limb where it has ``limbs``, and the tank's bounds where it has ``tank``.

    Args:
        episode: Any episode.
        path: Of the PNG file; written whole or not at all.
    """
    figure = plain_figure(
        figsize=(WIDTH, 1.2 + PANEL_HEIGHT * max(len(_time_panels(episode)), 3)), layout="constrained"
    )
    figure.suptitle(_title(episode), fontsize=12, x=0.01, ha="left")
    right: AnyFigure = figure
    if episode.pose or episode.target:
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[2, 3])[0]
        for axes, (title, across, up) in zip(left.subplots(2, 1), PLANES, strict=True):
            draw_path(axes, episode, title, across, up)
            _style(axes)
    _draw_over_time(right, episode)
    FigureCanvasAgg(figure)
    with whole_file(Path(path)) as stream:
        figure.savefig(stream, format="png", dpi=RESOLUTION)
    return Path(path)


def samples_to_draw(episode: Episode) -> slice:
    """Returns which samples to draw."""
    return slice(None, None, max(1, len(episode) // MOST_POINTS))


def draw_path(axes: Axes, episode: Episode, title: str, across: int, up: int) -> None:
    """Draws where frames went (solid) and where their targets were (dashed), in one plane [m]."""
    rows = samples_to_draw(episode)
    names = list(dict.fromkeys((*episode.pose, *episode.target)))
    for index, name in enumerate(names):
        colour = css(series_colour(index))
        if name in episode.target:
            path = episode.target[name][rows]
            axes.plot(path[:, across], path[:, up], "--", color=colour, linewidth=1.0, alpha=0.8)
        if name in episode.pose:
            path = episode.pose[name][rows]
            axes.plot(path[:, across], path[:, up], color=colour, linewidth=1.6, label=name)
            axes.plot(path[0, across], path[0, up], "o", color=colour, markersize=5)
    axes.set(xlabel=f"{AXIS_NAMES[across]} [m]", ylabel=f"{AXIS_NAMES[up]} [m]")
    axes.set_title(f"{title}: path, target dashed", loc="left", fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # y grows to the robot's left: seen from behind its shoulders
    axes.margins(0.12)
    axes.legend(fontsize=8, loc="best")


def draw_error(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws each frame's distance to its target [mm]."""
    for index, name in enumerate(frames_with_target(episode)):
        gap = episode.pose[name][rows, :3] - episode.target[name][rows, :3]
        distance = 1000 * np.linalg.norm(gap, axis=1)
        axes.plot(episode.time[rows], distance, color=css(series_colour(index)), label=name)
    _finish(axes, "distance\nto target [mm]", len(frames_with_target(episode)))


def frames_with_target(episode: Episode) -> tuple[str, ...]:
    """Returns the frames with a pose and a target."""
    return tuple(name for name in episode.pose if name in episode.target)


def draw_force(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws the force of each wrench [N]: its size, and its vertical part dotted."""
    for index, (name, wrench) in enumerate(episode.wrench.items()):
        colour = css(series_colour(index))
        size = np.linalg.norm(wrench[rows, :3], axis=1)
        axes.plot(episode.time[rows], size, color=colour, label=f"{name}: |f|")
        axes.plot(episode.time[rows], wrench[rows, 2], ":", color=colour, label=f"{name}: f z")
    axes.axhline(0.0, color="0.7", linewidth=0.6)
    _finish(axes, "force [N]", 2 * len(episode.wrench))


def draw_tank(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws the energy tank's level [J] between its floor and maximum."""
    if episode.tank is None:
        return
    axes.plot(episode.time[rows], episode.tank[rows], color=css(series_colour(2)), label="level")
    bounds = episode.metadata.get("tank")
    for name in ("floor", "max"):
        if isinstance(bounds, Mapping) and isinstance(bounds.get(name), int | float):
            axes.axhline(bounds[name], color=css(LIMIT), linestyle="--", linewidth=0.9)
            axes.annotate(
                name, (1.0, bounds[name]), xycoords=("axes fraction", "data"), fontsize=7, va="center"
            )
    axes.set_ylim(bottom=0.0)
    _finish(axes, "tank [J]", 0)


def draw_torque(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws commanded (else measured) torque: over its limit where limits are known, else in N.m."""
    kind = "effort_command" if episode.effort_command else "effort"
    torques: Mapping[str, Vector] = getattr(episode, kind)
    limits = episode.metadata.get("effort_max")
    known = isinstance(limits, Mapping) and all(joint in limits for joint in torques)
    groups = _limbs(episode, tuple(torques))
    for index, (limb, joints) in enumerate(groups.items()):
        colour = css(series_colour(index))
        scaled = [torques[joint][rows] / (limits[joint] if known and limits else 1.0) for joint in joints]
        if len(joints) == 1:
            axes.plot(episode.time[rows], scaled[0], color=colour, linewidth=0.9, label=limb)
            continue
        for torque in scaled:
            axes.plot(episode.time[rows], torque, color=colour, linewidth=0.7, alpha=0.45)
        label = f"{limb}: largest"
        axes.plot(episode.time[rows], np.abs(scaled).max(axis=0), color=colour, label=label)
    if known:
        for bound in (-1.0, 1.0):
            axes.axhline(bound, color=css(LIMIT), linestyle="--", linewidth=0.9)
    _finish(axes, "torque / limit" if known else f"{kind}\n[N.m]", len(groups))


def draw_hinge(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws the angle of the held object's hinge [rad], as measured."""
    angle = episode.extra[HINGE_COLUMNS[0]]
    axes.plot(episode.time[rows], angle[rows], color=css(series_colour(0)))
    _finish(axes, "hinge [rad]", 0)


def draw_position(axes: Axes, episode: Episode, rows: slice) -> None:
    """Draws joint positions [rad], one colour per limb."""
    groups = _limbs(episode, episode.joints)
    for index, (limb, joints) in enumerate(groups.items()):
        for number, joint in enumerate(joints):
            axes.plot(
                episode.time[rows],
                episode.position[joint][rows],
                color=css(series_colour(index)),
                linewidth=0.9,
                label=limb if number == 0 else None,
            )
    _finish(axes, "position [rad]", len(groups))


def shade_phases(axes: Axes, episode: Episode, *, named: bool) -> None:
    """Shades every other phase, and writes the names above the topmost panel."""
    for index, interval in enumerate(episode.phase_intervals()):
        start, end = episode.time[interval.start], episode.time[min(interval.stop, len(episode) - 1)]
        if index % 2 == 0:
            axes.axvspan(start, end, color="0.93", zorder=0, linewidth=0)
        axes.axvline(start, color="0.75", linewidth=0.6, zorder=0)
        if named:
            place = ((start + end) / 2, 1.03)
            axes.annotate(
                interval.phase,
                place,
                xycoords=("data", "axes fraction"),
                ha="center",
                fontsize=8,
                color="0.25",
            )


def _time_panels(episode: Episode) -> list[TimePanel]:
    """Returns the panels for which the episode has columns."""
    choice: list[tuple[bool, TimePanel]] = [
        (bool(frames_with_target(episode)), draw_error),
        (HINGE_COLUMNS[0] in episode.extra, draw_hinge),
        (bool(episode.wrench), draw_force),
        (episode.tank is not None, draw_tank),
        (bool(episode.effort_command or episode.effort), draw_torque),
        (not episode.pose, draw_position),
    ]
    return [panel for wanted, panel in choice if wanted] or [draw_position]


def _draw_over_time(figure: AnyFigure, episode: Episode) -> None:
    drawn = _time_panels(episode)
    column = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    rows = samples_to_draw(episode)
    for index, (axes, panel) in enumerate(zip(column, drawn, strict=True)):
        panel(axes, episode, rows)
        shade_phases(axes, episode, named=index == 0)
        _style(axes)
    column[-1].set_xlabel("time [s]")


def _style(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="0.9", linewidth=0.5)
    axes.tick_params(labelsize=8)


def _title(episode: Episode) -> str:
    length = episode.time[-1] - episode.time[0]
    ended = "" if episode.complete else ", not finished"
    return f"{episode.name} on {episode.robot}: {length:.1f} s, {len(episode)} samples{ended}"


def _limbs(episode: Episode, joints: Sequence[str]) -> dict[str, list[str]]:
    """Returns the joints by limb where the metadata says so, else each joint by itself."""
    declared = episode.metadata.get("limbs")
    if not isinstance(declared, Mapping):
        return {joint: [joint] for joint in joints}
    groups = {limb: [joint for joint in names if joint in joints] for limb, names in declared.items()}
    return {limb: names for limb, names in groups.items() if names} or {joint: [joint] for joint in joints}


def _finish(axes: Axes, label: str, curves: int) -> None:
    axes.set_ylabel(label)
    axes.margins(x=0.0)
    if 0 < curves <= MOST_LABELS:
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
