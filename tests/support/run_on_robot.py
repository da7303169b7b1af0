# SPDX-License-Identifier: BSD-3-Clause
"""Runs a task on another robot than its own, as ``impedance run TASK --robot NAME`` does."""

from __future__ import annotations

from pathlib import Path

from impedance_modules.control.assembly import assemble
from impedance_modules.control.supervisor import Ending
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.run_backends import make_backend
from impedance_modules.runs.task_acceptance import accept


def run_on_robot(task: str, robot: str, out: Path, duration: float | None) -> Ending:
    """Checks a task, runs it on the built-in plant, and returns how it ended."""
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None, robot_name=robot)
    accept(assembly)
    backend = make_backend(assembly, backend="sim", log=None, seed=0)
    options = RunOptions(out=out, seed=0, duration=duration, live=False, read_only=False, backend="sim")
    return carry_out(assembly, backend, options, lambda *_: None).ending
