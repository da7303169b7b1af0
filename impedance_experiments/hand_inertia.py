# SPDX-License-Identifier: BSD-3-Clause
"""Inertia of a hand by posture: arms with their inertia and mobility ellipsoids (thesis 4.4, fig. 4-4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impedance_experiments.page import Cell, Plot, Table, table_of
from impedance_experiments.pushing import only_arm
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.superposition.operational_inertia import linear_ellipsoid

Array = NDArray[np.float64]

POSTURES = {"elbow-out": 0.04, "elbow-up": 0.04, "arm-stretched": 0.0004}
"""Task -> length that stands for a kilogram in its picture [m/kg]."""
PER_MOBILITY = 0.3
"""Length that stands for 1/kg in all pictures [m.kg]."""
VIEWS = {"from above": (0, 1), "from the right": (0, 2)}
NAMES = "xyz"


@dataclass(frozen=True)
class HandInertia:
    """A hand in one posture.

    Attributes:
        mobility: (3, 3) Y_v = J_v (M + I_r)^-1 J_v^T, world axes [1/kg].
        joints: (k, 3) where the arm's links begin, the hand last [m].
    """

    mobility: Array
    joints: Array

    @property
    def masses(self) -> Array:
        """(3,) principal apparent masses, heaviest first [kg]: one over the mobility's eigenvalues."""
        return 1.0 / linear_ellipsoid(self.mobility).half_axes

    @property
    def anisotropy(self) -> float:
        """Heaviest over lightest."""
        return float(self.masses[0] / self.masses[-1])


def hand_inertia(task: str) -> HandInertia:
    """Takes a task's start posture."""
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
    arm, model, posture = only_arm(assembly), assembly.model, assembly.modules.posture
    moved = posture.copy()
    moved[model.limbs[arm].joints] += 0.1
    poses = [(model.pose(posture, frame), model.pose(moved, frame)) for frame in model.frames]
    links = [old.translation for old, new in poses if not np.allclose(old.rotation, new.rotation)]
    return HandInertia(analyse_task(assembly, None).arms[arm].mobility[:3, :3], np.array(links))


def mass_table(found: Mapping[str, HandInertia]) -> Table:
    """Tabulates apparent masses along the axes and along the principal directions."""
    rows: list[list[Cell]] = []
    for name, hand in found.items():
        along = 1.0 / np.diag(hand.mobility)
        mobile = 1.0 / hand.masses
        rows.append([name, *map(float, (*along, *hand.masses, hand.anisotropy, mobile[0], mobile[-1]))])
    columns = (
        "posture", "along x [kg]", "along y [kg]", "along z [kg]", "heaviest [kg]", "middle [kg]", "lightest [kg]",
        "heaviest over lightest", "least mobility [1/kg]", "most mobility [1/kg]",
    )  # fmt: skip
    return table_of("Apparent mass of the hand, free to turn, reflected inertia included", columns, rows)


def ellipsoid_plot(found: Mapping[str, HandInertia]) -> Plot:
    """Draws the arms from above and from the side, with the outlines of both ellipsoids around the hand."""
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    rows = figure.subplots(len(VIEWS), len(found), squeeze=False)
    for column, (name, hand) in enumerate(found.items()):
        for axes, (view, plane) in zip(rows[:, column], VIEWS.items(), strict=True):
            _draw(axes, hand, plane, POSTURES[name])
            axes.set(
                title=f"{name}, {view}", xlabel=f"{NAMES[plane[0]]} [m]", ylabel=f"{NAMES[plane[1]]} [m]"
            )
            axes.set_aspect("equal", adjustable="datalim")
        rows[0, column].legend(fontsize=7, loc="best")
    caption = (
        "Arms and, around the hand, outlines of the inertia ellipsoid (half axes: apparent masses; note the scale, a "
        "hundredth for the stretched arm) and of the mobility ellipsoid, which stays small and finite near the "
        "singular posture (fig. 4-4)"
    )
    return Plot("inertia", caption, figure)


def _draw(axes: Axes, hand: HandInertia, plane: tuple[int, int], per_kilogram: float) -> None:
    picked = list(plane)
    axes.plot(*hand.joints[:, picked].T, "o-", color="0.5", ms=3)
    centre = hand.joints[-1, picked]
    inertia: Array = np.asarray(per_kilogram * np.linalg.inv(hand.mobility))
    mobility: Array = np.asarray(PER_MOBILITY * hand.mobility)
    shown = (
        (inertia, "C3", f"inertia, 0.1 m = {0.1 / per_kilogram:g} kg"),
        (mobility, "C0", f"mobility, 0.1 m = {0.1 / PER_MOBILITY:.2g} /kg"),
    )
    for matrix, colour, label in shown:
        axes.plot(*np.add(centre[:, None], outline(matrix, plane)), color=colour, label=label)


def outline(matrix: Array, plane: tuple[int, int]) -> Array:
    """Gives the shadow (2, 200) on a plane of the ellipsoid A u, |u| = 1, of a symmetric (3, 3) matrix A."""
    picked = matrix[list(plane)]
    values, vectors = np.linalg.eigh(picked @ picked.T)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ np.vstack([np.cos(turn), np.sin(turn)]))
