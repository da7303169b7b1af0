# SPDX-License-Identifier: BSD-3-Clause
"""Two mirrored planar arms: their endpoint inertias add, and the coupling of y cancels (eq. 4.28-4.30)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue
from impedance_modules.arrays import Array
from impedance_modules.superposition.examples import FIRST_ARM, LINK_LENGTH, MIRRORED_ARM, planar_inertia

NAMES = ("x", "y", "theta")
PRINTED = {
    "eq. 4.28, right arm": ((9.18, -2.5, 6.68), (-2.5, 9.18, -2.5), (6.68, -2.5, 5.86)),
    "eq. 4.29, left arm": ((9.18, 2.5, 6.68), (2.5, 9.18, 2.5), (6.68, 2.5, 5.86)),
    "eq. 4.30, both": ((18.36, 0.0, 13.36), (0.0, 18.36, 0.0), (13.36, 0.0, 11.72)),
}
"""As the thesis prints them, in kg, kg.m and kg.m^2."""


def reproduce(settings: Settings) -> Page:  # noqa: ARG001 - all experiments are called alike
    """Adds the two arms' inertias and lays the sums beside the printed matrices."""
    right, left = (planar_inertia(np.radians(arm)) for arm in (FIRST_ARM, MIRRORED_ARM))
    found = dict(zip(PRINTED, (right, left, right + left), strict=True))
    worst = max(float(np.max(np.abs(found[name] - np.array(PRINTED[name])))) for name in PRINTED)
    return Page(
        summary="Three equal links per arm, the left arm the mirror image of the right one, both hands on one "
        "point. Each arm's endpoint inertia couples y with x and theta; in the sum the coupling is gone. "
        "Nothing about a closed chain was computed: the inertias were added.",
        comparisons=_comparisons(found),
        tables=tuple(_matrix(name, found[name]) for name in PRINTED),
        plots=(_picture(found),),
        differences="None beyond the last printed digit. The thesis does not print its links; solid cylinders of "
        "5 kg, 1 m and 0.1 m radius were recovered from its results.",
        facts={"worst": worst, "coupling": float(np.max(np.abs((right + left)[1, [0, 2]])))},
    )


def _comparisons(found: dict[str, Array]) -> tuple[ThesisValue, ...]:
    rows = []
    for name, printed in PRINTED.items():
        for i, j, unit in ((0, 0, "kg"), (0, 1, "kg"), (0, 2, "kg.m"), (2, 2, "kg.m^2")):
            quantity = f"{name}, Lambda_{NAMES[i]},{NAMES[j]}"
            ours = round(float(found[name][i, j]), 3) + 0.0
            rows.append(ThesisValue(quantity, printed[i][j], ours, unit, "same links, same law"))
    return tuple(rows)


def _matrix(name: str, matrix: Array) -> ResultTable:
    rows: list[list[Cell]] = [
        [NAMES[i], *(round(float(value), 3) + 0.0 for value in row)] for i, row in enumerate(matrix)
    ]
    return ResultTable(f"{name} [kg, kg.m, kg.m^2]", ("", *NAMES), rows)


def _picture(found: dict[str, Array]) -> Plot:
    """Draws each arm, and the ellipse v^T Lambda v = 1 of its translational mobility at the hand."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    arms = ((FIRST_ARM,), (MIRRORED_ARM,), (FIRST_ARM, MIRRORED_ARM))
    for axes, (name, matrix), drawn in zip(figure.subplots(1, 3), found.items(), arms, strict=True):
        for arm in drawn:
            _draw_arm(axes, np.radians(arm))
        mobility = np.linalg.inv(matrix)[:2, :2]
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        ellipse = np.linalg.cholesky(mobility) @ np.vstack([np.cos(turn), np.sin(turn)])
        axes.plot(*ellipse, color="C1", label="mobility ellipse [kg^-1/2]")
        axes.set(aspect="equal", title=name, xlabel="x [m]")
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(fontsize=7, loc="lower left")
    return Plot(
        "arms", "The arms and the mobility at the common hand point: tilted singly, upright together", figure
    )


def _draw_arm(axes: Axes, link_angles: Array) -> None:
    """Draws a chain that ends at the origin."""
    steps = LINK_LENGTH * np.column_stack([np.cos(link_angles), np.sin(link_angles)])
    points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    axes.plot(*(points - points[-1]).T, "o-", color="0.4", linewidth=3, markersize=5)
