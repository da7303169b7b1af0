# SPDX-License-Identifier: BSD-3-Clause
"""Two mirrored planar arms: their endpoint inertias add, and the coupling of y cancels (eq. 4.28-4.30).

Robot ``two_planar_arms``, task ``planar-arms``: analysed and summed by the same code as any other task.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from impedance_experiments.task_run import frames_of
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.superposition.object_impedance import HandImpedance, superpose

TASK = "planar-arms"
PLANE = (0, 1, 5)
"""Of the six coordinates those in which planar arms move: x, y and the turn about z."""
NAMES = ("x", "y", "theta")
PRINTED = {
    "eq. 4.28, right arm": ((9.18, -2.5, 6.68), (-2.5, 9.18, -2.5), (6.68, -2.5, 5.86)),
    "eq. 4.29, left arm": ((9.18, 2.5, 6.68), (2.5, 9.18, 2.5), (6.68, 2.5, 5.86)),
    "eq. 4.30, both": ((18.36, 0.0, 13.36), (0.0, 18.36, 0.0), (13.36, 0.0, 11.72)),
}
"""As the thesis prints them, in kg, kg.m and kg.m^2."""


def reproduce(settings: Settings) -> Page:  # noqa: ARG001 - all experiments are called alike
    """Adds the two arms' inertias and lays the sums beside the printed matrices."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    held = analyse_task(assembly, None).sum
    if held is None:
        raise ValueError(f"task '{TASK}' holds nothing")
    first, mirrored = held.hands.values()
    sums = ([first], [mirrored], [first, mirrored])
    found = dict(zip(PRINTED, (planar_inertia_of(part) for part in sums), strict=True))
    worst = max(float(np.max(np.abs(found[name] - np.array(PRINTED[name])))) for name in PRINTED)
    coupling = float(np.max(np.abs(found["eq. 4.30, both"][1, [0, 2]])))
    return Page(
        summary=f"Three equal links per arm, the left arm the mirror image of the right one, both hands on one point "
        f"(robot `{assembly.robot.name}`, task `{TASK}`; `impedance analyze {TASK}` prints the mobilities). Each arm's "
        "endpoint inertia couples y with x and theta; in the sum the coupling is gone. Nothing about a closed chain "
        "was computed: the arms are summed as any arms are. They cannot leave their plane, so their six by six "
        "inertias do not exist; their mobilities are joined by the parallel sum, and what is shown is its inverse in "
        "the plane.",
        comparisons=_comparisons(found),
        tables=tuple(_matrix(name, found[name]) for name in PRINTED),
        plots=(_picture(assembly, found),),
        differences=f"None beyond the last printed digit ({worst:.1g} at most). The thesis does not print its links; "
        "the solid cylinders of the robot's file were recovered from its results.",
        facts={"worst": worst, "coupling": coupling},
    )


def planar_inertia_of(hands: list[HandImpedance]) -> Array:
    """Sums what hands offer an object without mass; (3, 3) in (x, y, theta) at its origin [kg, kg.m, kg.m^2]."""
    mobility = superpose(hands, None).inertia.mobility
    return np.asarray(np.linalg.inv(mobility[np.ix_(PLANE, PLANE)]))


def _comparisons(found: dict[str, Array]) -> tuple[ThesisValue, ...]:
    rows = []
    for name, printed in PRINTED.items():
        for i, j, unit in ((0, 0, "kg"), (0, 1, "kg"), (0, 2, "kg.m"), (2, 2, "kg.m^2")):
            quantity = f"{name}, Lambda_{NAMES[i]},{NAMES[j]}"
            ours = round(float(found[name][i, j]), 3) + 0.0
            rows.append(ThesisValue(quantity, printed[i][j], ours, unit, "links recovered, same law"))
    return tuple(rows)


def _matrix(name: str, matrix: Array) -> ResultTable:
    rows: list[list[Cell]] = [
        [NAMES[i], *(round(float(value), 3) + 0.0 for value in row)] for i, row in enumerate(matrix)
    ]
    return ResultTable(f"{name} [kg, kg.m, kg.m^2]", ("", *NAMES), rows)


def _picture(assembly: Assembly, found: dict[str, Array]) -> Plot:
    """Draws each arm, and the ellipse v^T Lambda v = 1 of its translational mobility at the hand."""
    figure, columns = panels((7.0, 3.0), 1, 3, sharex=True, sharey=True)
    arms = list(assembly.task.arms)
    for axes, (name, matrix), drawn in zip(columns, found.items(), (arms[:1], arms[1:], arms), strict=True):
        for arm in drawn:
            _draw_arm(axes, assembly, arm)
        mobility = np.linalg.inv(matrix)[:2, :2]
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        ellipse = np.linalg.cholesky(mobility) @ np.vstack([np.cos(turn), np.sin(turn)])
        axes.plot(*ellipse, color="C1", label="mobility ellipse [kg^-1/2]")
        axes.set(aspect="equal", title=name, xlabel="x [m]")
    columns[0].set_ylabel("y [m]")
    figure.legend(*columns[0].get_legend_handles_labels(), loc="outside upper center")
    return Plot(
        "arms", "The arms and the mobility at the common hand point: tilted singly, upright together", figure
    )


def _draw_arm(axes: Axes, assembly: Assembly, arm: str) -> None:
    """Draws an arm with its hand at the origin."""
    q = assembly.modules.posture
    points = np.array([assembly.model.pose(q, frame).translation[:2] for frame in frames_of(assembly, arm)])
    axes.plot(*(points - points[-1]).T, "o-", color="0.4", linewidth=3, markersize=5)
