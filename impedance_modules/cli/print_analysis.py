# SPDX-License-Identifier: BSD-3-Clause
"""How ``analyze`` prints: each arm, then the sum at the object as in the thesis's eq. 4.30."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from rich.box import SIMPLE
from rich.columns import Columns
from rich.console import Console
from rich.table import Table
from rich.text import Text

from impedance_modules.arrays import Array
from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.analysis import Analysis, FrameImpedance, carried_inertia
from impedance_modules.spec.task import AXES
from impedance_modules.spec.task_draft import twist_signs
from impedance_modules.superposition.operational_inertia import (
    Ellipsoid,
    angular_ellipsoid,
    carry_inertia,
    linear_ellipsoid,
)

QUANTITIES = (
    ("inertia", "kg, kg.m, kg.m^2"),
    ("inertia_without_reflected", "kg, kg.m, kg.m^2"),
    ("mobility", "1/kg, 1/(kg.m), 1/(kg.m^2)"),
    ("damping", "N.s/m, N.s, N.m.s"),
    ("stiffness", "N/m, N, N.m"),
    ("compliance", "m/N, 1/N, 1/(N.m)"),
    ("stiffness_without_preload", "N/m, N, N.m"),
)

ELLIPSOIDS = (
    ("inertia", "kg", "kg.m^2"),
    ("mobility", "1/kg", "1/(kg.m^2)"),
    ("stiffness", "N/m", "N.m"),
)

SLOWEST_MODES = 10
"""Of a frame's modes that are printed."""


def print_analysis(assembly: Assembly, analysis: Analysis) -> None:
    """Prints inertia, damping and stiffness of every arm, and of the object."""
    console = Terminal(highlight=False)
    where = "at the start posture" if analysis.phase is None else f"at rest where '{analysis.phase}' ends"
    console.print(
        styled("[bold]{}[/bold] on {}, {}; world axes", assembly.task.name, assembly.robot.name, where)
    )
    for limb, frame_impedance in analysis.arms.items():
        console.rule(f"{limb}: {frame_impedance.frame}")
        _print_at_hand(console, frame_impedance, analysis)
    if analysis.object is not None:
        console.rule("object: the arms' sum")
        _print_sum(console, assembly, analysis)
        _print_at_hand(console, analysis.object, analysis)


def _print_at_hand(console: Console, frame_impedance: FrameImpedance, analysis: Analysis) -> None:
    console.print(f"origin {_vector(frame_impedance.position)} m")
    carried = "modules exert" if frame_impedance.frame == "object" else "joint springs carry"
    console.print(
        f"{carried} {_vector(frame_impedance.preload[:3])} N, {_vector(frame_impedance.preload[3:])} N.m"
    )
    if frame_impedance.frame in analysis.pressure:
        force = analysis.pressure[frame_impedance.frame]
        console.print(f"surfaces press {_vector(force[:3])} N, {_vector(force[3:])} N.m")
    if frame_impedance.frame == "object" and analysis.squeeze is not None:
        console.print(f"hands squeeze with {analysis.squeeze:.2f} N each")
    if frame_impedance.folds:
        console.print(styled("[red]folds[/red]: the springs cannot hold the load; no stiffness is given"))
    matrices = [
        _matrix(name.replace("_", " "), unit, getattr(frame_impedance, name))
        for name, unit in QUANTITIES
        if name != "compliance" or frame_impedance.compliance is not None
    ]
    console.print(Columns(matrices))
    console.print(_ellipsoids(frame_impedance))
    console.print("modes " + ", ".join(_modes(frame_impedance)), soft_wrap=True)


def _print_sum(console: Console, assembly: Assembly, analysis: Analysis) -> None:
    """Prints right + left + object = sum, all at the object's origin."""
    inertias = {limb: carried_inertia(hand).inertia for limb, hand in analysis.summands.items()}
    unit = "kg, kg.m, kg.m^2"
    parts = [_matrix(f"inertia of '{limb}', at the object", unit, m) for limb, m in inertias.items()]
    parts.append(_matrix("inertia of the object itself", unit, analysis.own))
    stiffnesses = {
        limb: None if hand.stiffness is None else carry_inertia(hand.stiffness, hand.offset)
        for limb, hand in analysis.summands.items()
    }
    parts += [
        _matrix(f"stiffness of '{limb}', at the object", "N/m, N, N.m", m) for limb, m in stiffnesses.items()
    ]
    console.print(Columns(parts))
    frame_impedance = analysis.object
    mirror = assembly.robot.mirror
    if frame_impedance is None or mirror is None:
        return
    for name, single, total in (
        ("inertia", inertias, frame_impedance.inertia),
        ("stiffness", stiffnesses, frame_impedance.stiffness),
    ):
        shares = [f"{limb} {_across(m, mirror.plane)}" for limb, m in single.items()]
        console.print(
            f"{name}: coupling across the mirror plane {mirror.plane}: {', '.join(shares)};"
            f" in the sum {_across(total, mirror.plane)} of the largest entry"
        )


def _across(matrix: Array | None, plane: str) -> str:
    """Gives the largest entry that couples motions in a plane with motions across it, as a share."""
    if matrix is None:
        return "-"
    signs = twist_signs(plane)
    odd = 0.5 * (matrix - signs[:, None] * matrix * signs)
    return f"{100.0 * float(np.max(np.abs(odd)) / np.max(np.abs(matrix))):.2f} %"


def _matrix(title: str, unit: str, matrix: Array | None) -> Table:
    """Lays a (6, 6) out in its four blocks; the off-diagonal ones couple moving with turning."""
    table = Table(
        title=styled("{} [dim]{}[/dim]", title, unit), title_justify="left", box=SIMPLE, padding=(0, 0, 0, 1)
    )
    table.add_column("")
    for axis in (*AXES[:3], "", *AXES[3:]):
        table.add_column(axis, justify="right", min_width=7 if axis else 1)
    if matrix is None:
        table.add_row("", "does not exist")
        return table
    largest = float(np.max(np.abs(matrix)))
    for index, axis in enumerate(AXES):
        entries = [_entry(value, largest) for value in matrix[index]]
        table.add_row(axis, *entries[:3], styled("[dim]|[/dim]"), *entries[3:])
        if index == 2:
            table.add_section()
    return table


def _entry(value: float, largest: float) -> str | Text:
    return styled("[dim]0[/dim]") if abs(value) < 1e-9 * largest else f"{value:.3g}"


def _ellipsoids(frame_impedance: FrameImpedance) -> Table:
    title = "ellipsoids: principal values and the direction of the largest"
    table = Table(title=title, title_justify="left", box=SIMPLE, padding=(0, 1))
    for heading in ("of", "values", "largest along"):
        table.add_column(heading)
    for name, moving, turning in ELLIPSOIDS:
        matrix = getattr(frame_impedance, name)
        if matrix is not None:
            table.add_row(f"{name}, linear", *_axes(linear_ellipsoid(matrix), moving))
            table.add_row(f"{name}, angular", *_axes(angular_ellipsoid(matrix), turning))
    return table


def _axes(found: Ellipsoid, unit: str) -> tuple[str, str]:
    values = ", ".join(f"{value:.4g}" for value in found.half_axes)
    largest = int(np.argmax(np.abs(found.half_axes)))
    return f"{values} {unit}", _vector(found.directions[:, largest])


def _modes(frame_impedance: FrameImpedance) -> Iterator[str]:
    for mode in frame_impedance.modes[:SLOWEST_MODES]:
        if mode.damping_ratio is None:
            yield "free"
        else:
            yield f"{mode.frequency / (2.0 * math.pi):.2f} Hz (ratio {mode.damping_ratio:.2f})"


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{value + 0.0:.3f}" for value in values) + ")"
