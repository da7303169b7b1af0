# SPDX-License-Identifier: BSD-3-Clause
"""``impedance analyze``: what a push on a hand, or on the object in both hands, meets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from impedance_modules.cli.options import effects_option, task_argument


@click.command("analyze")
@task_argument
@click.option("--phase", metavar="NAME", help="At rest where this phase ends  [default: the start posture].")
@effects_option
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path), metavar="F", help="Write the matrices to a file."
)
def command(task: str, phase: str | None, effects: Path | None, json_file: Path | None) -> int:
    """Analyse TASK: inertia, damping and stiffness of every arm, and their sum at the object.

    Matrices are 6x6, linear then angular, in world axes at the frame's origin, SI units. Exit: 0, 2 bad input.
    """
    from impedance_modules.cli.tables_analyze import print_analysis
    from impedance_modules.control.adjust import as_taught
    from impedance_modules.control.assembly import assemble
    from impedance_modules.prediction.analysis import analyse_task, write_analysis

    assembly = assemble(task, effects=effects, rate=None, scale=1.0, arm=None)
    assembly = replace(assembly, task=as_taught(assembly.task))
    analysis = analyse_task(assembly, phase)
    if json_file is not None:
        write_analysis(analysis, json_file)
    print_analysis(assembly, analysis)
    return 0
