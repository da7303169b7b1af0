# SPDX-License-Identifier: BSD-3-Clause
"""``impedance probe``: the shortest safe motion that answers what a diagnosis left open, as a task to run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.errors import BadInput

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.diagnosis.data.nominal_model import NominalModel
    from impedance_modules.diagnosis.experiment_design.probe_choice import Probe
    from impedance_modules.spec.robot_spec import RobotSpec

PATH = click.Path(path_type=Path)

LARGEST_DIAGNOSIS = 100_000_000
"""Bytes of an answer that is read."""

UNTESTED_NEED = 50.0
"""Tank with which a probe's energy need is predicted [J]."""


@click.command("probe")
@click.argument("diagnosis", metavar="[DIAGNOSIS.json]", required=False, type=PATH)
@click.option("--robot", metavar="NAME", help="Robot that will move; its folder gives limits and links.")
@click.option(
    "--urdf", type=PATH, help="URDF or MuJoCo model (XML) instead of a robot: tables of the motion, no task."
)
@click.option("--out", required=True, type=PATH, metavar="DIR", help="Folder for what is written.")
def probe_command(diagnosis: Path | None, robot: str | None, urdf: Path | None, out: Path) -> int:
    """Propose the next motion to record: the shortest safe one that answers what DIAGNOSIS.json leaves open.

    Without a diagnosis, a motion that shows every joint in every way. Writes DIR/probe.yaml, a task for
    `impedance run`, and DIR/probe.json; with --urdf DIR/motion.csv and DIR/postures.csv instead of the task.
    Exit: 0 done, 2 bad input.
    """
    from impedance_modules.diagnosis.experiment_design.probe_choice import propose_probe

    if (robot is None) == (urdf is None):
        raise BadInput("probe needs to know what moves: give --robot NAME or --urdf FILE, one of them")
    answer = None if diagnosis is None else _answer(diagnosis)
    console = Terminal()
    with _model(robot, urdf) as (spec, model, file):
        with console.status("looking for a motion") as status:
            probe = propose_probe(answer, model, file, spec, lambda words: status.update(Text(words)))
        written = _write(probe, spec, out)
    for note in model.notes:
        console.print(styled("[yellow]note:[/yellow] {}", note))
    _print(probe, written, console)
    return 0


@contextmanager
def _model(robot: str | None, urdf: Path | None) -> Iterator[tuple[RobotSpec | None, NominalModel, Path]]:
    from impedance_modules.diagnosis.data.model_file import compared_model, driven_joints
    from impedance_modules.diagnosis.data.nominal_model import model_of_spec
    from impedance_modules.spec.robot_reader import read_robot

    if urdf is not None:
        with compared_model(urdf, dict.fromkeys(driven_joints(urdf), 0.0), {}) as compared:
            yield None, compared.model, compared.urdf
        return
    spec = read_robot(str(robot))
    yield spec, model_of_spec(spec, list(spec.joints)), spec.urdf


def _answer(path: Path) -> dict[str, Any]:
    """Reads a diagnosis as `impedance diagnose --json` writes it."""
    from impedance_modules.input_files import read_input
    from impedance_modules.spec.schema import first_schema_error
    from impedance_modules.strict_json import parse_json

    try:
        found = parse_json(read_input(path, LARGEST_DIAGNOSIS))
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from error
    except ValueError as error:
        raise BadInput(f"{path}: not JSON: {error} (valid: what diagnose --json wrote)") from error
    deviation = first_schema_error(found, "diagnosis")
    if deviation is not None:
        raise BadInput(f"{path}: {deviation} (valid: what diagnose --json wrote)")
    answer: dict[str, Any] = found
    return answer


def _write(probe: Probe, spec: RobotSpec | None, out: Path) -> list[Path]:
    """Writes the files; the task with the tank that its own prediction asks for."""
    from impedance_modules.diagnosis.experiment_design.probe_choice import resisting_work
    from impedance_modules.diagnosis.experiment_design.probe_files import (
        motion_table,
        posture_table,
        probe_object,
        task_text,
    )
    from impedance_modules.spec.locate import list_robots

    texts = {"probe.json": json.dumps(probe_object(probe), indent=2, allow_nan=False) + "\n"}
    proposal, predictor = probe.proposal, probe.predictor
    if spec is None:
        texts["motion.csv"] = motion_table(proposal, predictor)
        texts["postures.csv"] = posture_table(proposal, predictor)
    else:
        named = spec.name if spec.name in list_robots() else json.dumps(str(spec.folder.resolve()))

        def text(need: float) -> str:
            return task_text(proposal, predictor, spec, probe.request.purpose, robot=named, need=need)

        texts["probe.yaml"] = text(_need(text(UNTESTED_NEED)) + resisting_work(probe))
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, content in texts.items():
            (out / name).write_text(content, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{out}: cannot be written: {error.strerror} (valid: a writable folder)") from error
    return [out / name for name in texts]


def _need(text: str) -> float:
    """Predicts what a task's tank needs [J]."""
    import tempfile

    from impedance_modules.control.assembly import assemble
    from impedance_modules.prediction.energy_need import forecast_tank
    from impedance_modules.prediction.mechanism import Mechanism
    from impedance_modules.prediction.quasi_static import predict_motion

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "probe.yaml"
        path.write_text(text, encoding="utf-8")
        assembly = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
        return forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need


def _print(probe: Probe, written: list[Path], console: Console) -> None:
    from rich.table import Table

    proposal = probe.proposal
    console.print(f"to {probe.request.purpose}")
    console.print(f"{', '.join(proposal.motion.kinds)}: {proposal.motion.duration:.1f} s")
    table = Table("question", "expected chi-square", "share", "answered")
    for item in proposal.expected:
        found = item.separation
        table.add_row(item.question.name, f"{found.chi_square:.0f}", f"{found.share:.2f}", item.outlook)
    console.print(table)
    for item in proposal.expected:
        if item.reason:
            console.print(styled("[yellow]no motion tells[/yellow] {}: {}", item.question.name, item.reason))
    if proposal.pair:
        console.print(f"nearest links: {proposal.pair}, {proposal.nearest:.3f} m")
    for path in written:
        console.print(f"written: {path}", soft_wrap=True)
