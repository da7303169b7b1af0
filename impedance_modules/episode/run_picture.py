# SPDX-License-Identifier: BSD-3-Clause
"""One still picture of a run, for reports and for people without a viewer."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from impedance_modules.episode import panels
from impedance_modules.episode.data import Episode
from impedance_modules.episode.run_folder import whole_file

PICTURE_KINDS: tuple[str, ...] = (
    "position",
    "effort_command",
    "effort",
    "wrench",
    "pose",
    "target",
    "tank",
    "phase",
)
"""What a picture can show; ``read_episode(path, PICTURE_KINDS)`` spares the memory of the rest."""
WIDTH = 13.0
PANEL_HEIGHT = 1.9
RESOLUTION = 130
"""Dots per inch."""


def write_picture(episode: Episode, path: Path) -> Path:
    """Draws hand paths against targets, force, tank and torque over limit, with the phases shaded.

    What was not recorded has no panel. Torque is drawn over its limit where the metadata has ``effort_max``,
    by limb where it has ``limbs``, and the tank's bounds where it has ``tank``.

    Args:
        episode: Any episode.
        path: Of the PNG file; written whole or not at all.
    """
    figure = Figure(
        figsize=(WIDTH, 1.2 + PANEL_HEIGHT * max(len(_time_panels(episode)), 3)), layout="constrained"
    )
    figure.suptitle(_title(episode), fontsize=12, x=0.01, ha="left")
    right: panels.AnyFigure = figure
    if episode.pose or episode.target:
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[2, 3])[0]
        for axes, (title, across, up) in zip(left.subplots(2, 1), panels.PLANES, strict=True):
            panels.draw_path(axes, episode, title, across, up)
            _style(axes)
    _draw_over_time(right, episode)
    FigureCanvasAgg(figure)
    with whole_file(Path(path)) as stream:
        figure.savefig(stream, format="png", dpi=RESOLUTION)
    return Path(path)


def _time_panels(episode: Episode) -> list[panels.TimePanel]:
    """Returns the panels for which the episode has columns."""
    choice: list[tuple[bool, panels.TimePanel]] = [
        (bool(panels.frames_with_target(episode)), panels.draw_error),
        (bool(episode.wrench), panels.draw_force),
        (episode.tank is not None, panels.draw_tank),
        (bool(episode.effort_command or episode.effort), panels.draw_torque),
        (not episode.pose, panels.draw_position),
    ]
    return [panel for wanted, panel in choice if wanted] or [panels.draw_position]


def _draw_over_time(figure: panels.AnyFigure, episode: Episode) -> None:
    drawn = _time_panels(episode)
    column = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    rows = panels.thinning(episode)
    for index, (axes, panel) in enumerate(zip(column, drawn, strict=True)):
        panel(axes, episode, rows)
        panels.shade_phases(axes, episode, named=index == 0)
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
