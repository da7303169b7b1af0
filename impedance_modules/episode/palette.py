# SPDX-License-Identifier: BSD-3-Clause
"""Colours shared by the rerun view and the still picture; distinct also for colour-blind eyes (Okabe-Ito)."""

from __future__ import annotations

Colour = tuple[int, int, int, int]

SERIES: tuple[Colour, ...] = (
    (0, 114, 178, 255),
    (213, 94, 0, 255),
    (0, 158, 115, 255),
    (204, 121, 167, 255),
    (230, 159, 0, 255),
    (86, 180, 233, 255),
    (140, 100, 60, 255),
    (110, 110, 110, 255),
)
BODY: dict[str, Colour] = {
    "robot": (150, 160, 172, 255),
    "object": (214, 158, 60, 255),
    "surface": (120, 140, 120, 130),
}
SPRING: Colour = (240, 228, 66, 255)
FORCE: Colour = (213, 94, 0, 255)
TORQUE: Colour = (204, 121, 167, 255)
LIMIT: Colour = (200, 60, 60, 255)


def series_colour(index: int) -> Colour:
    """Returns the colour of the ``index``-th line of a plot; repeats after eight."""
    return SERIES[index % len(SERIES)]


def css(colour: Colour) -> str:
    """Returns the colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour[:3])
