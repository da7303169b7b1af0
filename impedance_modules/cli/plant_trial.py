# SPDX-License-Identifier: BSD-3-Clause
"""When ``check`` and ``run`` try a task on the built-in plant before they accept it, and how they say so."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.control.assembly import Assembly
    from impedance_modules.prediction.feasibility import TaskPrediction
    from impedance_modules.runs.trial_run import Trial


def tried(assembly: Assembly, prediction: TaskPrediction, seed: int, console: Console) -> Trial | None:
    """Tries a task that would meet joint limits; None for one that would not, or where ``allow_unstable`` waives it.

    Args:
        assembly: The task.
        prediction: Of it.
        seed: Of the simulated noise.
        console: Where a bar is shown.

    Raises:
        BadFile: A joint is too fast there.
    """
    from impedance_modules.prediction.joint_limits import limits_met

    met = limits_met(assembly.model, prediction)
    if not met or assembly.allow_unstable:
        return None
    # Imported only here: from this line on functions are compiled.
    from impedance_modules.cli.print_run import progress
    from impedance_modules.runs.trial_run import try_on_plant

    with progress(sum(phase.duration for phase in assembly.task.phases), console) as on_progress:
        return try_on_plant(assembly, met, seed, on_progress)


def trial_line(trial: Trial) -> str:
    """One sentence for people."""
    return (
        f"tried on the built-in plant, because it would meet joint limits: {trial.ended}; fastest joint"
        f" {trial.joint}, {trial.speed:.2f} of {trial.limit:g} rad/s"
    )
