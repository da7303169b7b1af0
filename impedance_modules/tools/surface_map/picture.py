# SPDX-License-Identifier: BSD-3-Clause
"""A map as a picture: what was touched, the shape at rest, and the stiffness, beside the truth where it is known."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impedance_modules.tools.surface_fit import SurfaceMap
from impedance_modules.tools.surface_truth import TrueSurface

MILLIMETRES = 1000.0
TWO_SIGMA = 2.0


def draw_map(found: SurfaceMap, truth: TrueSurface | None) -> Figure:
    """Draws shape above, stiffness below, over the way along the stroke.

    Args:
        found: The map.
        truth: What the plant really had, or None.
    """
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    _draw_shape(above, found, truth)
    _draw_stiffness(below, found, truth)
    x, y, _ = found.origin
    below.set_xlabel(
        f"along ({found.direction[0]:.2f}, {found.direction[1]:.2f}) from x = {x:.3f} m, y = {y:.3f} m [mm]"
    )
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        axes.spines.top.set_visible(False)
        axes.spines.right.set_visible(False)
    return figure


def _draw_shape(axes: Axes, found: SurfaceMap, truth: TrueSurface | None) -> None:
    along = MILLIMETRES * found.along
    if truth is not None:
        axes.plot(along, MILLIMETRES * truth.height, color="0.3", lw=1.2, label="truth, at rest")
    axes.plot(along, MILLIMETRES * found.pressed, ".", ms=4, color="C1", label="touched: the tactile map")
    axes.errorbar(
        along,
        MILLIMETRES * found.rest,
        TWO_SIGMA * MILLIMETRES * found.rest_error,
        fmt="o",
        ms=3,
        color="C0",
        label="at rest, two standard errors",
    )
    axes.set_ylabel("height [mm]")


def _draw_stiffness(axes: Axes, found: SurfaceMap, truth: TrueSurface | None) -> None:
    along = MILLIMETRES * found.along
    if truth is not None:
        axes.plot(along, 1.0 / truth.compliance, color="0.3", lw=1.2, label="truth")
    relative = found.compliance_error / found.compliance
    axes.errorbar(
        along,
        found.stiffness,
        TWO_SIGMA * relative * found.stiffness,
        fmt="o",
        ms=3,
        color="C0",
        label="stiffness, two standard errors",
    )
    axes.set_yscale("log")
    axes.set_ylabel("upward stiffness [N/m]")
