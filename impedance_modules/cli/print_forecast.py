# SPDX-License-Identifier: BSD-3-Clause
"""How ``check`` prints a forecast: torque of each arm in each phase, stability of the loops, tank, notes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from impedance_modules.cli.plant_trial import trial_line
from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.compensation_forecast import CompensationForecast
from impedance_modules.prediction.forecast import Deflection, Forecast, JointLoad, PhaseForecast
from impedance_modules.prediction.inner_loop_limit import InnerLoopLimit, inner_loop_limit
from impedance_modules.prediction.loop_stability import STIFFEST, StabilityForecast
from impedance_modules.spec.robot_postures import assumed_notes

if TYPE_CHECKING:
    from impedance_modules.runs.trial_run import Trial

TIGHT = 0.7
"""Share of a limit from which a number is coloured."""


def print_forecast(assembly: Assembly, forecast: Forecast, trial: Trial | None) -> None:
    """Prints everything that is predicted of a task, and how it went where it was tried."""
    console = Terminal(highlight=False)
    task = assembly.task
    delay = assembly.tank.delay
    console.print(
        styled("[bold]{}[/bold] on {}", task.name, assembly.robot.name)
        + f", {assembly.rate:g} Hz, torque acts {delay} period{'' if delay == 1 else 's'} late: the task is valid"
    )
    console.print(_loads(forecast))
    if any(phase.hinge is not None for phase in forecast.phases):
        console.print(_hinge(forecast))
    console.print(_loops(forecast))
    inner = inner_loop_limit(assembly)
    if inner is not None:
        console.print(_inner_loop(inner), soft_wrap=True)
    console.print(_tank(assembly, forecast))
    if forecast.compensation is not None:
        console.print(_compensation(forecast.compensation))
    if trial is not None:
        console.print(trial_line(trial), soft_wrap=True)
    for note in (*forecast.notes, *assumed_notes(assembly.robot)):
        console.print(styled("[yellow]note[/yellow]: {}", note), soft_wrap=True)


def _loads(forecast: Forecast) -> Table:
    table = Table(
        title="phases, predicted quasi-statically; at rest where each ends",
        title_justify="left",
        box=SIMPLE,
        padding=(0, 1, 0, 0),
    )
    table.add_column("phase")
    table.add_column("takes", justify="right")
    table.add_column("arm")
    for heading in ("torque N.m", "with weight", "yields at rest", "pressed N"):
        table.add_column(heading, justify="right")
    for phase in forecast.phases:
        first = True
        for row in _rows(phase):
            table.add_row(*(_phase_cells(phase) if first else ("", "")), *row)
            first = False
        table.add_section()
    return table


def _phase_cells(phase: PhaseForecast) -> tuple[str, str]:
    played = phase.predicted
    seconds = f"{played.ended - played.began:.2f} s"
    return played.name, f"{seconds}, met" if played.met else seconds


def _rows(phase: PhaseForecast) -> list[tuple[str | Text, ...]]:
    rows: list[tuple[str | Text, ...]] = [
        (arm.limb, _load(arm.commanded), _load(arm.total), _yields(arm.deflection), _force(arm.contact_force))
        for arm in phase.arms
    ]
    if phase.object is not None:
        rows.append(("object", "", "", _yields(phase.object.deflection), _force(phase.object.contact_force)))
    rows += [(name, "", "", _yields(stretched), "") for name, stretched in phase.between.items()]
    return rows


def _load(load: JointLoad) -> str | Text:
    text = f"{load.short} {load.torque:.1f} of {load.limit:g}"
    if load.share > 1.0:
        return styled("[red]{}[/red]", text)
    return styled("[yellow]{}[/yellow]", text) if load.share > TIGHT else text


def _yields(deflection: Deflection | None) -> str:
    if deflection is None:
        return "-"
    return f"{1e3 * deflection.distance:.1f} mm, {math.degrees(deflection.angle):.1f}°"


def _force(force: float | None) -> str:
    return "-" if force is None else f"{force:.1f}"


def _hinge(forecast: Forecast) -> Table:
    """Lays out how far the object's hinge turns in each phase, and what resists."""
    table = Table(title="hinge of the object", title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0))
    table.add_column("phase")
    for heading in (
        "angle rad",
        "target rad",
        "resists N.m",
        "friction N.m",
        "on the bearing N",
        "off the arc mm",
    ):
        table.add_column(heading, justify="right")
    for phase in forecast.phases:
        if phase.hinge is None:
            continue
        found = phase.hinge
        table.add_row(
            phase.predicted.name,
            f"{found.began:.3f} to {found.ended:.3f}",
            f"{found.target:.3f}",
            f"{found.torque:.2f}",
            f"{found.friction:g}",
            _force(found.bearing),
            f"{1e3 * found.off_arc[0]:.1f}",
        )
    return table


def _loops(forecast: Forecast) -> Table:
    table = Table(
        title="sampled loop around the elastic joints, in free motion", title_justify="left", box=SIMPLE
    )
    table.add_column("from")
    table.add_column("loop")
    table.add_column("least damped (ratio)", justify="right")
    table.add_column("endpoint N/m", justify="right")
    table.add_column("highest stable N/m", justify="right")
    shown: set[int] = set()
    for phase in forecast.phases:
        if id(phase.loops) in shown:
            continue
        shown.add(id(phase.loops))
        for loop in phase.loops:
            table.add_row(phase.predicted.name, *_loop(loop))
    return table


def _loop(loop: StabilityForecast) -> tuple[str, str | Text, str, str | Text]:
    mode: str | Text = "-"
    if loop.frequency is not None and loop.damping_ratio is not None:
        mode = f"{loop.frequency:.1f} Hz ({loop.damping_ratio:.3f})"
    if not loop.stable:
        mode = styled("[red]unstable: {}[/red]", mode)
    if loop.stiffness == 0.0:
        return loop.name, mode, "none", "-"
    if loop.scale is None:
        highest: str | Text = f"over {STIFFEST * loop.stiffness:.0f} (x {STIFFEST:g})"
    elif loop.scale == 0.0:
        highest = styled("[red]none, however soft[/red]")
    else:
        highest = f"{loop.scale * loop.stiffness:.0f} (x {loop.scale:.2f})"
    return loop.name, mode, f"{loop.stiffness:.0f}", highest


def _inner_loop(found: InnerLoopLimit) -> Text:
    """Says up to which gain the robot's own torque loops are passive."""
    limit, verdict = found.limit, "passive" if found.passive else "[red]not passive[/red]"
    most = "any gain" if math.isinf(limit.gain) else f"at most {limit.gain:.2f}"
    return styled(
        "inner torque loop: gain {} ("
        + verdict
        + ": {}, by {} at {} rad/s); rotors appear {} times lighter\n",
        f"{found.gain:g}",
        most,
        limit.joint,
        f"{limit.frequency:.0f}",
        f"{1.0 + found.gain:g}",
    )


def _tank(assembly: Assembly, forecast: Forecast) -> Table:
    tank = forecast.tank
    table = Table(title="energy the tank must cover", title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0))
    table.add_column("of what")
    table.add_column("J", justify="right")
    for name, cost in sorted(tank.costs.items(), key=lambda item: -item[1]):
        if abs(cost) >= 0.005:
            table.add_row(name, f"{cost:.2f}")
    table.add_section()
    table.add_row(f"needed, tightest in '{tank.phase}' at {tank.time:.1f} s", f"{tank.need:.2f}")
    filled = assembly.tank.initial
    table.add_row(f"in the tank at the start ({filled / tank.need:.2f} times the need)", f"{filled:.2f}")
    table.add_section()
    table.add_row("sensing: measured work is true to within", f"{tank.sensing:.2f}")
    return table


def _compensation(found: CompensationForecast) -> Table:
    """Lays out what each compensated effect costs: torque, energy from the tank, energy that the claim counts."""
    table = Table(
        title="compensated, each effect by itself", title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0)
    )
    table.add_column("effect")
    table.add_column("of")
    for heading in ("torque N.m", "tank pays J", "potential at the start J"):
        table.add_column(heading, justify="right")
    for cost in found.costs:
        keys = cost.effect.keys
        more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
        torque = f"{cost.joint} {cost.torque:.2f} of {cost.limit:g}"
        given = f"{cost.given:.2f}" if cost.effect.has_potential else "-"
        table.add_row(Text(cost.effect.name), Text(f"{keys[0]}{more}"), torque, f"{cost.drawn:.2f}", given)
    return table
