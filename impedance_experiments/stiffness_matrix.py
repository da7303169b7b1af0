# SPDX-License-Identifier: BSD-3-Clause
"""Eq. 5.1 and the symmetric case of Appendix C: the thesis's net stiffness, and what a displacement would measure.

Both are computed by the package's own law (4.24) from the thesis's chain. The thesis passes the wrench of the springs
at the hand, F = -K_end (x_d - x_act); what the joint springs carry is another wrench, and none where they are relaxed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_experiments.thesis_chain import chain_hand
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.superposition import examples
from impedance_modules.superposition.net_stiffness import NetStiffness, net_stiffness

AXES = ("x", "y", "z", "rx", "ry", "rz")
UNITS = (("N/m", "N"), ("N", "N.m/rad"))
"""Of the four (3, 3) blocks."""
PRINTED = (
    (296.96, 6.34, -8.46, -7.76, 14.93, -3.73),
    (296.12, -4.34, -2.86, 3.25, -1.65),
    (71.84, 5.63, -5.69, 2.27),
    (1.03, -2.70, 1.42),
    (8.35, -1.41),
    (0.84,),
)
"""Eq. 5.1, its upper triangle."""


@dataclass(frozen=True)
class Case:
    """One configuration of Appendix C.

    Attributes:
        q: (7,) [rad].
        end: (6, 6) K_end at the hand.
        actual, desired: (3,) printed x_act and x_d [m].
    """

    q: Array
    end: Array
    actual: Array
    desired: Array

    def net(self, *, loaded: bool) -> NetStiffness:
        """Computes (4.24) with the thesis's wrench, or with relaxed joint springs."""
        wrench = np.zeros(6)
        if loaded:
            wrench[:3] = -self.end[:3, :3] @ (self.desired - self.actual)
        return net_stiffness(examples.thesis_jacobian(self.q), examples.JOINT_STIFFNESS, self.end, wrench)


ANTISYMMETRIC = Case(examples.POSTURE, examples.END_STIFFNESS, examples.ACTUAL, examples.DESIRED)
"""The listing's "anti_symm", from which eq. 5.1 is."""
SYMMETRIC = Case(
    np.array([0.948767, -0.4552, -0.10929, 1.6, -3.04456, -0.42631, 1.4388]),
    np.diag([300.0, 300.0, 300.0, 0.0, 0.0, 0.0]),
    np.array([0.6566, -0.2296, -0.1002]),
    np.array([0.66686, -0.224838, -0.03168 - 0.03 - 0.0741]),
)
"""The listing's "sym": its inputs are printed, its matrix is not."""


def reproduce(settings: Settings) -> Page:  # noqa: ARG001 - all experiments are called alike
    """Computes both cases with both wrenches."""
    cases = {"eq. 5.1": ANTISYMMETRIC, "symmetric case": SYMMETRIC}
    found = {
        (name, loaded): _matrix_of(case, loaded) for name, case in cases.items() for loaded in (True, False)
    }
    printed = np.concatenate([np.array(row) for row in PRINTED])
    ours = np.concatenate([found["eq. 5.1", True][i, i:] for i in range(6)])
    folds = {name: case.net(loaded=True).folds for name, case in cases.items()}
    return Page(
        summary=_summary(found, folds),
        comparisons=(*_printed_rows(found["eq. 5.1", True]), *_other_rows(found), *_place_rows(cases)),
        tables=tuple(_table(name, loaded, matrix) for (name, loaded), matrix in found.items()),
        plots=(_picture(found),),
        differences=_differences(cases, found),
        facts={
            "worst": float(np.abs(ours - printed).max()),
            "smallest eigenvalue": _smallest(found["eq. 5.1", True]),
            "relaxed x": float(found["eq. 5.1", False][0, 0]),
            "relaxed z": float(found["eq. 5.1", False][2, 2]),
            "symmetric, smallest eigenvalue": _smallest(found["symmetric case", True]),
            "symmetric, relaxed, smallest eigenvalue": _smallest(found["symmetric case", False]),
        },
    )


def _matrix_of(case: Case, loaded: bool) -> Array:
    matrix = case.net(loaded=loaded).at_hand
    if matrix is None:
        raise ValueError("the thesis's posture is singular")
    return matrix


def _smallest(matrix: Array) -> float:
    return float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0])


def _summary(found: dict[tuple[str, bool], Array], folds: dict[str, bool]) -> str:
    folding = " and ".join(name for name, fold in folds.items() if fold) or "neither"
    return (
        "The thesis's net stiffness (4.24) for its first task, and for the second configuration that its Appendix C "
        "lists with equal springs in all three directions, of which it prints the inputs alone. Both come from the "
        "law that `impedance analyze` uses, with the wrench passed in; docs/control-law.md says what eq. 5.1 is and "
        f"is not. With the thesis's wrench the smallest eigenvalue is {_smallest(found['eq. 5.1', True]):.2f} for eq. "
        f"5.1 and {_smallest(found['symmetric case', True]):.2f} in the symmetric case (SI units); the arm folds under "
        f"that wrench in: {folding}. With relaxed joint springs, which is what a small "
        f"displacement measures, they are {_smallest(found['eq. 5.1', False]):.2g} and "
        f"{_smallest(found['symmetric case', False]):.2g}."
    )


def _unit(i: int, j: int) -> str:
    return UNITS[i // 3][j // 3]


def _printed_rows(ours: Array) -> list[ThesisValue]:
    return [
        ThesisValue(
            f"eq. 5.1, K_{AXES[i]},{AXES[i + k]}",
            f"{printed:.2f}",
            f"{ours[i, i + k]:.3f}",
            _unit(i, i + k),
            "the thesis's wrench and its printed x_act; its last digit is not always rounded",
        )
        for i, row in enumerate(PRINTED)
        for k, printed in enumerate(row)
    ]


def _other_rows(found: dict[tuple[str, bool], Array]) -> list[ThesisValue]:
    """Gives the diagonals that the thesis does not print."""
    rows = []
    for name, loaded in (("eq. 5.1", False), ("symmetric case", True), ("symmetric case", False)):
        wrench = "with the thesis's wrench" if loaded else "joint springs relaxed"
        for i, axis in enumerate(AXES):
            value = round(float(found[name, loaded][i, i]), 3)
            reason = (
                "what a small displacement measures"
                if not loaded
                else "its inputs are printed, its matrix is not"
            )
            rows.append(ThesisValue(f"{name}, K_{axis},{axis}, {wrench}", None, value, _unit(i, i), reason))
    return rows


def _place_rows(cases: dict[str, Case]) -> list[ThesisValue]:
    """Compares the printed places of the hand with the chain's."""
    return [
        ThesisValue(
            f"{name}, x_act, {axis}",
            float(case.actual[i]),
            round(float(chain_hand(case.q).translation[i]), 4),
            "m",
            "the thesis's own chain at the printed angles",
        )
        for name, case in cases.items()
        for i, axis in enumerate("xyz")
    ]


def _table(name: str, loaded: bool, matrix: Array) -> ResultTable:
    rows: list[list[Cell]] = [
        [AXES[i], *(round(float(value), 3) + 0.0 for value in row)] for i, row in enumerate(matrix)
    ]
    wrench = "with the thesis's wrench" if loaded else "with relaxed joint springs"
    return ResultTable(f"{name}, {wrench} [N/m, N, N.m/rad]", ("", *AXES), rows)


def _picture(found: dict[tuple[str, bool], Array]) -> Plot:
    """Draws the diagonals of the linear and of the angular block."""
    figure, (linear, angular) = panels((7.0, 3.4), 1, 2)
    place = np.arange(3)
    for k, ((name, loaded), matrix) in enumerate(found.items()):
        label = f"{name}, {'the wrench of the thesis' if loaded else 'relaxed'}"
        linear.bar(place + 0.2 * k - 0.3, np.diag(matrix)[:3], 0.2, label=label)
        angular.bar(place + 0.2 * k - 0.3, np.diag(matrix)[3:], 0.2)
    linear.set_xticks(place, AXES[:3])
    angular.set_xticks(place, AXES[3:])
    linear.set_ylabel("stiffness [N/m]")
    angular.set_ylabel("stiffness [N.m/rad]")
    figure.legend(*linear.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return Plot("diagonals", "Diagonals of the net stiffness: the wrench that is passed in decides", figure)


def _differences(cases: dict[str, Case], found: dict[tuple[str, bool], Array]) -> str:
    height = {name: chain_hand(case.q).translation[2] - case.actual[2] for name, case in cases.items()}
    loaded, relaxed = (np.diag(found["eq. 5.1", loaded])[:3] for loaded in (True, False))
    apart = ", ".join(f"{100.0 * (b / a - 1.0):+.0f} %" for a, b in zip(loaded, relaxed, strict=True))
    return (
        "**The wrench.** Eq. 5.1 takes the force of the springs at the hand for the load that turns with the joints. "
        "It "
        "is carried by those springs themselves, not by the joint springs; with relaxed joint springs the stiffness "
        f"along x, y and z differs from eq. 5.1 by {apart}.\n\n"
        "**The place.** The printed x_act is not where the chain puts the hand at the printed angles: its height is "
        "off "
        f"by {1e3 * height['eq. 5.1']:+.0f} mm for eq. 5.1 and by {1e3 * height['symmetric case']:+.0f} mm in the "
        "symmetric case. The wrench is computed from the printed place, as in the listing. Joint S0 has the listing's "
        "stiffness, ten times that of Tables 5.1 and B.1."
    )
