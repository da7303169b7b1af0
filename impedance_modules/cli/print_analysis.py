# SPDX-License-Identifier: BSD-3-Clause
"""How ``analyze`` prints: each arm, then the sum at the object as in the thesis's eq. 4.30."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.box import SIMPLE
from rich.columns import Columns
from rich.console import Console
from rich.table import Table
from rich.text import Text

from impedance_modules.arrays import Array
from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.analysis import Analysis, CouplingOfHands, FrameImpedance, SpringState
from impedance_modules.prediction.analysis_json import in_hertz, quaternion_of
from impedance_modules.spec.task import AXES
from impedance_modules.superposition.hinge_impedance import HingeImpedance
from impedance_modules.superposition.modes import VibrationMode
from impedance_modules.superposition.object_sum import ObjectSum
from impedance_modules.superposition.operational_inertia import Ellipsoid, angular_ellipsoid, linear_ellipsoid

QUANTITIES = (
    ("inertia", "kg, kg.m, kg.m^2"),
    ("inertia_without_reflected", "kg, kg.m, kg.m^2"),
    ("mobility", "1/kg, 1/(kg.m), 1/(kg.m^2)"),
    ("damping", "N.s/m, N.s, N.m.s"),
    ("stiffness", "N/m, N, N.m"),
    ("compliance", "m/N, 1/N, 1/(N.m)"),
    ("stiffness_without_preload", "N/m, N, N.m"),
)

ELLIPSOID_UNITS = {
    "inertia": ("kg", "kg.m^2"),
    "mobility": ("1/kg", "1/(kg.m^2)"),
    "stiffness": ("N/m", "N.m"),
}

MORE = {
    "object": "of the object itself",
    "load": "by the load: lever arms that turn",
    "between": "by springs between the hands",
}
"""What adds up at the object besides its arms."""

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
        _print_at_frame(console, frame_impedance)
    for spring in analysis.between:
        console.rule(f"between arms: {spring.name}")
        _print_spring(console, spring)
    for group in analysis.coupled:
        console.rule(f"coupled: {' and '.join(group.limbs)}")
        _print_coupling(console, group)
    if analysis.object is not None and analysis.sum is not None:
        console.rule("object: the arms' sum")
        _print_sum(console, analysis.sum)
        _print_at_frame(console, analysis.object)
    if analysis.hinge is not None:
        console.rule("object: about its hinge")
        _print_hinge(console, analysis.hinge)


def _print_at_frame(console: Console, frame_impedance: FrameImpedance) -> None:
    console.print(
        f"origin {_vector(frame_impedance.position)} m, orientation"
        f" {_vector(quaternion_of(frame_impedance.rotation))} as quaternion x, y, z, w",
        soft_wrap=True,
    )
    if frame_impedance.until_rest is not None:
        joint, angle = max(frame_impedance.until_rest.items(), key=lambda item: abs(item[1]))
        turn = f"{round(angle, 3) + 0.0:.3f}"
        console.print(styled("from the end of the phase until rest {} turns most, by {} rad", joint, turn))
    console.print(
        f"preload, what the joint springs carry: {_wrench(frame_impedance.preload)}", soft_wrap=True
    )
    console.print(f"modules exert {_wrench(frame_impedance.wrench)}", soft_wrap=True)
    if frame_impedance.pressure is not None:
        console.print(f"surfaces press {_wrench(frame_impedance.pressure)}", soft_wrap=True)
    if frame_impedance.friction is not None:
        hold = frame_impedance.friction
        console.print(
            f"friction of {hold.force:.3f} N stops it at {_vector(hold.position)} m", soft_wrap=True
        )
    if frame_impedance.folds:
        console.print(styled("[red]folds[/red]: the springs cannot hold the load; no stiffness is given"))
    matrices = [
        _matrix(name.replace("_", " "), unit, getattr(frame_impedance, name))
        for name, unit in QUANTITIES
        if name != "compliance" or frame_impedance.compliance is not None
    ]
    console.print(Columns(matrices))
    console.print(_ellipsoids(frame_impedance))
    console.print("modes " + ", ".join(_modes(frame_impedance.modes)), soft_wrap=True)


def _print_spring(console: Console, spring: SpringState) -> None:
    first, second = spring.frames
    console.print(f"from {second} to {first}, in axes that turn with both", soft_wrap=True)
    turn = _vector(spring.stretch[3:])
    console.print(
        f"stretched by {_vector(spring.stretch[:3])} m, {turn} rad: {spring.energy:.4f} J", soft_wrap=True
    )
    console.print(f"exerts on {first} {_wrench(spring.wrench)}", soft_wrap=True)
    pairs = (("stiffness", spring.stiffness), ("damping", spring.damping))
    console.print(Columns([_matrix(name, dict(QUANTITIES)[name], matrix) for name, matrix in pairs]))


def _print_coupling(console: Console, group: CouplingOfHands) -> None:
    """Prints the blocks between different hands: what one feels where the other moves."""
    if group.folds:
        console.print(styled("[red]folds[/red]: the springs cannot hold the load; no stiffness is given"))
    tables = []
    for name, matrix in (("stiffness", group.stiffness), ("damping", group.damping)):
        for i, first in enumerate(group.limbs if matrix is not None else ()):
            for k, second in enumerate(group.limbs):
                if i != k and matrix is not None:
                    title = f"{name} of '{first}' by motions of '{second}'"
                    tables.append(_matrix(title, dict(QUANTITIES)[name], matrix[i, k]))
    console.print(Columns(tables))
    console.print("modes together " + ", ".join(_modes(group.modes)), soft_wrap=True)


def _print_sum(console: Console, found: ObjectSum) -> None:
    """Prints right + left + the object's own = sum, all at the object's origin."""
    parts: list[Table] = []
    for name, unit in (("inertia", "kg, kg.m, kg.m^2"), ("stiffness", "N/m, N, N.m")):
        summands = found.summands[name]
        parts += [_matrix(f"{name} of '{limb}', at the object", unit, m) for limb, m in summands.arms.items()]
        parts += [_matrix(f"{name} {MORE[more]}", unit, m) for more, m in summands.more.items()]
    console.print(Columns(parts))
    for name, coupling in found.coupling.items():
        shares = [f"{limb} {_percent(share)}" for limb, share in coupling.arms.items()]
        console.print(
            f"{name}: coupling across the mirror plane {found.plane}: {', '.join(shares)};"
            f" in the sum {_percent(coupling.sum)} of the largest entry",
            soft_wrap=True,
        )
    console.print(f"hands squeeze with {found.squeeze:.2f} N each")
    for limb, wrench in found.internal.items():
        console.print(f"'{limb}' exerts against the others {_wrench(wrench)}", soft_wrap=True)


def _print_hinge(console: Console, found: HingeImpedance) -> None:
    """Prints the modules' sum about the hinge's axis, what the hinge adds itself, and what hands and weight exert."""
    console.print(f"angle {found.angle:.4f} rad", soft_wrap=True)
    for name, unit, parts in (
        ("inertia", "kg.m^2", found.inertia),
        ("damping", "N.m.s/rad", found.damping),
        ("stiffness", "N.m/rad", found.stiffness),
    ):
        arms = [f"{limb} {_number(part)}" for limb, part in parts.arms.items()]
        more = [f"{MORE[key]} {_number(part)}" for key, part in parts.more.items()]
        console.print(
            f"{name} about the axis {_number(parts.sum)} {unit}: {', '.join([*arms, *more])}", soft_wrap=True
        )
    own = found.own
    console.print(
        f"the hinge itself: friction {own.friction:g} N.m, damping {own.damping:g} N.m.s/rad, return spring"
        f" {own.stiffness:g} N.m/rad",
        soft_wrap=True,
    )
    console.print(
        f"hands and weight exert {found.torque:.3f} N.m about the axis and {_vector(found.bearing)} N on the bearing",
        soft_wrap=True,
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.2f} %"


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
    for name, (moving, turning) in ELLIPSOID_UNITS.items():
        matrix = getattr(frame_impedance, name)
        if matrix is not None:
            table.add_row(f"{name}, linear", *_axes(linear_ellipsoid(matrix), moving))
            table.add_row(f"{name}, angular", *_axes(angular_ellipsoid(matrix), turning))
    return table


def _axes(found: Ellipsoid, unit: str) -> tuple[str, str]:
    values = ", ".join(f"{value:.4g}" for value in found.half_axes)
    largest = int(np.argmax(np.abs(found.half_axes)))
    return f"{values} {unit}", _vector(found.directions[:, largest])


def _modes(modes: Sequence[VibrationMode]) -> Iterator[str]:
    for mode in modes[:SLOWEST_MODES]:
        if mode.damping_ratio is None:
            yield "free"
        else:
            yield f"{in_hertz(mode):.2f} Hz (ratio {mode.damping_ratio:.2f})"


def _wrench(values: Array) -> str:
    return f"{_vector(values[:3])} N, {_vector(values[3:])} N.m"


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{round(float(value), 3) + 0.0:.3f}" for value in values) + ")"
