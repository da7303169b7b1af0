# SPDX-License-Identifier: BSD-3-Clause
"""``impedance check``: is a task right, and what will it do? ``impedance analyze``: what does a push on it meet?"""

from __future__ import annotations

from pathlib import Path

import click

from impedance_modules.cli.plant_trial import tried
from impedance_modules.cli.shared_options import (
    arm_option,
    compensate_option,
    effects_option,
    rate_option,
    robot_option,
    scale_option,
    task_argument,
)


@click.command("check")
@task_argument
@effects_option
@compensate_option
@rate_option
@scale_option
@arm_option
@robot_option
def check_command(
    task: str,
    effects: Path | None,
    compensate: Path | None,
    rate: float | None,
    scale: float,
    arm: str | None,
    robot: str | None,
) -> int:
    """Check TASK, a file or the name of a shipped task, and predict what it will do.

    Torque margins, yielding under load, stability of the sampled loop, and the energy the tank must cover; of a task
    with playback, as its springs teach it. A task that would meet joint limits is tried on the built-in plant: there
    no joint may be faster than declared. Every problem is printed as file:line:col: path: message. Exit: 0 good,
    2 not.
    """
    from impedance_modules.cli.print_forecast import print_forecast
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.control.assembly import assemble, taught
    from impedance_modules.prediction.forecast import forecast_task
    from impedance_modules.runs.task_acceptance import accept

    assembly = assemble(
        task, effects=effects, compensate=compensate, rate=rate, scale=scale, arm=arm, robot_name=robot
    )
    prediction = accept(assembly)
    assembly = taught(assembly)
    trial = tried(assembly, prediction, seed=0, console=Terminal())
    print_forecast(assembly, forecast_task(assembly, prediction), trial)
    return 0


@click.command("analyze")
@task_argument
@click.option("--phase", metavar="NAME", help="At rest where this phase ends  [default: the start posture].")
@effects_option
@robot_option
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path), metavar="F", help="Write all of it to a file."
)
def analyze_command(
    task: str, phase: str | None, effects: Path | None, robot: str | None, json_file: Path | None
) -> int:
    """Analyse TASK: inertia, damping and stiffness of every arm, and their sum at the object.

    Matrices are 6x6, linear then angular, in world axes at the frame's origin, SI units. Exit: 0, 2 bad input.
    """
    from impedance_modules.cli.print_analysis import print_analysis
    from impedance_modules.control.assembly import assemble, taught
    from impedance_modules.prediction.analysis import analyse_task
    from impedance_modules.prediction.analysis_json import write_analysis

    assembly = taught(assemble(task, effects=effects, rate=None, scale=1.0, arm=None, robot_name=robot))
    analysis = analyse_task(assembly, phase)
    if json_file is not None:
        write_analysis(analysis, json_file)
    print_analysis(assembly, analysis)
    return 0
