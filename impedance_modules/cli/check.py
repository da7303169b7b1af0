# SPDX-License-Identifier: BSD-3-Clause
"""``impedance check``: is a task right, and what will it do?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from impedance_modules.cli.options import arm_option, effects_option, rate_option, scale_option, task_argument


@click.command("check")
@task_argument
@effects_option
@rate_option
@scale_option
@arm_option
def command(task: str, effects: Path | None, rate: float | None, scale: float, arm: str | None) -> int:
    """Check TASK, a file or the name of a shipped task, and predict what it will do.

    Torque margins, deflection under load, stability of the sampled loop, and the energy the tank must cover; of a task
    with playback, as its springs teach it. Every problem is
    printed as file:line:col: path: message. Exit: 0 good, 2 not.
    """
    from impedance_modules.cli.tables_check import print_forecast
    from impedance_modules.control.adjust import as_taught
    from impedance_modules.control.assembly import assemble
    from impedance_modules.prediction.feasibility import refuse_infeasible
    from impedance_modules.prediction.forecast import forecast_task

    assembly = assemble(task, effects=effects, rate=rate, scale=scale, arm=arm)
    assembly = replace(assembly, task=as_taught(assembly.task))
    prediction = refuse_infeasible(assembly)
    print_forecast(assembly, forecast_task(assembly, prediction))
    return 0
