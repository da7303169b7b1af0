# SPDX-License-Identifier: BSD-3-Clause
"""A diagnosis on the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from impedance_modules.diagnosis.result import Diagnosis, JointGap, Rollout

QUIET = 2.0
"""Residual over noise below which a velocity needs no row of its own."""

WORDS = {
    "no_gap": "no gap beyond noise and the links' inertia tolerance",
    "explained": "the gap is explained",
    "partly_explained": "the gap is partly explained",
    "unexplained": "there is a gap, not explained by the catalogue",
    "ambiguous": "these recordings cannot tell some causes apart",
    "insufficient_data": "the data do not suffice",
}


def print_diagnosis(found: Diagnosis, console: Console) -> None:
    """Prints verdict, gaps, causes, remainder and the next motion."""
    console.print(f"[bold]{found.verdict}[/bold]: {WORDS[found.verdict]}")
    if found.reason:
        console.print(found.reason)
    if found.data is not None:
        for warning in found.data.warnings:
            console.print(f"[yellow]note:[/yellow] {warning}")
    if found.gaps:
        console.print(_gaps(found))
        quiet = [gap.joint for gap in found.gaps if _quiet(gap)]
        if quiet:
            console.print(f"reported velocities are those of the positions: {', '.join(quiet)}")
    _print_causes(found, console)
    _print_rollouts(found, console)
    if found.remainder.structure:
        console.print(f"remainder: {found.remainder.structure}")
    purpose = found.next_motion.get("purpose")
    if purpose and purpose != "none needed":
        console.print(f"next motion: to {purpose}: {found.next_motion.get('excitation')}")


def _print_rollouts(found: Diagnosis, console: Console) -> None:
    """Prints how far the plant strays from the recordings, or why nobody tried."""
    rollout = found.rollout
    if rollout.windows:
        console.print(_rollouts(rollout))
    for item in rollout.left_out:
        console.print(f"not simulated: {item.what}: {item.why}")
    for cause in found.causes:
        if cause.rollout is not None and cause.rollout.verdict == "worsens":
            console.print(
                f"[yellow]note:[/yellow] {cause.effect} explains torque but makes the simulated motion worse,"
                f" error power by {1.0 / cause.rollout.ratio:.3g}"
            )


def _rollouts(rollout: Rollout) -> Table:
    title = f"simulated again, {rollout.windows} x {rollout.window:g} s: rms error of position"
    table = Table(title=title)
    for name in ("joint", "before", "after", "noise", "unit", "shrink"):
        table.add_column(name, justify="left" if name in ("joint", "unit") else "right")
    for joint, drift in rollout.position.items():
        shrink = "" if drift.shrink is None else f"{100 * drift.shrink:.0f} %"
        numbers = (f"{x:.3g}" for x in (drift.before, drift.after, drift.noise_floor))
        table.add_row(joint, *numbers, drift.unit, shrink)
    return table


def _quiet(gap: JointGap) -> bool:
    """Whether a reported velocity is what the position's derivative says, about."""
    return gap.residual == "velocity" and gap.before < QUIET * gap.noise_floor


def _gaps(found: Diagnosis) -> Table:
    table = Table(title="held-out residual, rms")
    for name in ("joint", "port", "before", "after", "noise", "unit", "shrink"):
        table.add_column(name, justify="left" if name in ("joint", "port", "unit") else "right")
    for gap in found.gaps:
        if _quiet(gap):
            continue
        shrink = "" if gap.shrink is None else f"{100 * gap.shrink:.0f} %"
        numbers = (f"{x:.3g}" for x in (gap.before, gap.after, gap.noise_floor))
        table.add_row(gap.joint, gap.residual, *numbers, gap.unit, shrink)
    return table


def _print_causes(found: Diagnosis, console: Console) -> None:
    """Prints each cause with its numbers, a line each: names and units stay whole on a narrow terminal."""
    for rank, cause in enumerate(found.causes, start=1):
        carriers = ", ".join(cause.joints) or ", ".join(cause.parameters)
        alone = "" if cause.shrink is None else f", alone it closes {100 * cause.shrink:.0f} % of the gap"
        console.print(
            f"{rank}. [bold]{cause.effect}[/bold] on {carriers}, {cause.port} port: weight {cause.weight:.2f}{alone}"
        )
        for key, symbols in cause.parameters.items():
            numbers = (f"{symbol} {e.value:.4g} ± {e.std:.2g} {e.unit}" for symbol, e in symbols.items())
            console.print(f"   {key}: {', '.join(numbers)}", highlight=False)
        if cause.equivalent:
            others = ", ".join(f"{rival.effect} {' '.join(rival.joints)}" for rival in cause.equivalent)
            console.print(f"   [yellow]or instead:[/yellow] {others}")
