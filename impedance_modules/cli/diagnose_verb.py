# SPDX-License-Identifier: BSD-3-Clause
"""``impedance diagnose``: where recordings and model differ, what causes it, how far the gap shrinks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from impedance_modules.cli.next_commands import Asked, next_commands
from impedance_modules.cli.plain_lines import say
from impedance_modules.cli.shared_options import held_positions
from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.diagnosis.result import DEFAULT_TOLERANCE
from impedance_modules.diagnosis.text_logs import GRAVITIES, SOURCES, Stated
from impedance_modules.errors import BadInput
from impedance_modules.extras import need
from impedance_modules.spec.robot_spec import EncoderSide

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Table

    from impedance_modules.diagnosis.gap_result import JointGap
from impedance_modules.diagnosis.result import Cause, Diagnosis

PATH = click.Path(path_type=Path)


@click.command("diagnose")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=PATH)
@click.option(
    "--holdout", multiple=True, type=PATH, metavar="LOG", help="Recording that no step of the fit may see."
)
@click.option("--robot", metavar="NAME", help="Robot whose model is compared.")
@click.option("--urdf", type=PATH, help="URDF or MuJoCo model (XML) that is compared, instead of a robot.")
@click.option(
    "--hold",
    multiple=True,
    metavar="JOINT=POSITION",
    help="With --urdf: where a joint stood that was not recorded [rad, or m if it slides].",
)
@click.option(
    "--map",
    "import_map",
    type=PATH,
    metavar="FILE",
    help="What the columns of a LOG mean that is no episode.",
)
@click.option("--effects", type=PATH, metavar="PATCH", help="Start from the model with this patch applied.")
@click.option("--without", multiple=True, metavar="EFFECT", help="Leave an effect out of the catalogue.")
@click.option("--under-water", is_flag=True, help="The robot was under water: look for what water does, too.")
@click.option(
    "--tolerance",
    type=click.FloatRange(0.0, 1.0, max_open=True),
    default=DEFAULT_TOLERANCE,
    show_default=True,
    metavar="SHARE",
    help="Of each joint's torque range: a gap within it that changes no simulated motion raises no alarm.",
)
@click.option("--jobs", type=int, metavar="J", help="Local cores  [default: 1].")
@click.option("--scheduler", metavar="ADDRESS", help="Use an existing Dask cluster instead of local cores.")
@click.option("--json", "json_path", type=PATH, metavar="F", help="Write the answer as JSON.")
@click.option("--report", type=PATH, metavar="F.html", help="Write a report as one HTML file.")
@click.option(
    "--recording", type=PATH, metavar="F.rrd", help="Write measured, predicted and regimes for the viewer."
)
@click.option("--patch", type=PATH, metavar="F.yaml", help="Write what was found as a patch.")
@click.option(
    "--effort-source",
    type=click.Choice(SOURCES),
    help="Of a text log that does not say it: where effort was measured  [default: joint_sensor].",
)
@click.option(
    "--encoder",
    type=click.Choice(get_args(EncoderSide)),
    help="Side of their gears on which the joints' positions were measured, where the robot file does not say it "
    " [default: unknown: the link's, and at joints that are called rigid the motor's is looked for].",
)
@click.option(
    "--gravity-compensation",
    type=click.Choice(GRAVITIES),
    help="Of a text log that does not say it: what held the arm's weight  [default: none].",
)
def diagnose_command(
    logs: tuple[Path, ...],
    holdout: tuple[Path, ...],
    robot: str | None,
    urdf: Path | None,
    hold: tuple[str, ...],
    import_map: Path | None,
    effects: Path | None,
    without: tuple[str, ...],
    under_water: bool,
    tolerance: float,
    jobs: int | None,
    scheduler: str | None,
    json_path: Path | None,
    report: Path | None,
    recording: Path | None,
    patch: Path | None,
    effort_source: str | None,
    encoder: EncoderSide | None,
    gravity_compensation: str | None,
) -> int:
    """Compare LOG..., recordings of one robot, with the model that was to predict them.

    A LOG is an episode, a run's directory, a folder of episodes as import makes it, or a text log: of libfranka, of
    RTDE, or a table with the columns time, position.JOINT, and velocity, effort, effort_command, position_command
    alike, in SI units. With --map, it may be any file that import reads.

    Exit: 0 no gap or explained, 2 bad input, 5 partly or not explained, 6 ambiguous, 7 data insufficient.
    """
    from impedance_modules.cli.diagnosis_progress import diagnosis_progress
    from impedance_modules.diagnosis.compared_recordings import diagnosed

    if report is not None:
        need("matplotlib", "--report")
    chosen = (
        ("--holdout", holdout),
        ("--hold", hold),
        ("--without", without),
        ("--effects", (effects,)),
        ("--encoder", (encoder,)),
        ("--map", (import_map,)),
    )
    options = [str(word) for key, values in chosen for value in values if value for word in (key, value)]
    asked = Asked(logs, robot, urdf, tuple(options), json_path)
    console = Terminal()
    with diagnosis_progress(console) as progress:
        found = diagnosed(
            logs,
            holdout,
            robot=robot,
            urdf=urdf,
            hold=held_positions(hold),
            import_map=import_map,
            stated=Stated(effort_source, gravity_compensation),
            encoder=encoder,
            effects=effects,
            without=without,
            under_water=under_water,
            tolerance=tolerance,
            jobs=jobs,
            scheduler=scheduler,
            progress=progress,
            note=lambda words: say(f"note: {words}", err=True),
        )
    commands = next_commands(asked, found.next_motion)
    _write(found, json_path, report, patch, commands)
    _write_recording(found, recording)
    print_diagnosis(found, console)
    for command in commands:
        console.print(styled("  {}", command), soft_wrap=True)
    return found.exit_code


def _write(
    found: Diagnosis,
    json_path: Path | None,
    report: Path | None,
    patch: Path | None,
    commands: Sequence[str],
) -> None:
    from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object

    if json_path is None and report is None and patch is None:
        return
    answer: dict[str, Any] = diagnosis_object(found)
    if json_path is not None:
        _save(json_path, json.dumps(answer, indent=2, allow_nan=False) + "\n")
    if report is not None:
        from impedance_modules.diagnosis.report.html_report import html_report

        _save(report, html_report(found, answer, commands))
    if patch is not None:
        from impedance_modules.diagnosis.report.diagnosis_files import patch_text, why_no_patch

        if answer["patch"] is None:
            say(f"{patch}: not written, {why_no_patch(found)}", err=True)
        else:
            _save(patch, patch_text(answer["patch"]))


def _write_recording(found: Diagnosis, path: Path | None) -> None:
    """Writes what the viewer shows, if there is anything to show."""
    if path is None:
        return
    if not found.series:
        say(f"{path}: not written, there is no residual to show", err=True)
        return
    from impedance_modules.episode.residual_view import ResidualCurves, write_residual_curves

    curves = [
        ResidualCurves(
            episode=item.episode,
            port=item.residual,
            joint=item.joint,
            unit=item.unit,
            time=item.time,
            measured=item.measured,
            before=item.before,
            after=item.after,
            regimes=item.regimes,
        )
        for item in found.series
    ]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_residual_curves(path, curves, f"diagnosis of {found.robot}")
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error} (valid: a writable place)") from error


def _save(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror} (valid: a writable place)") from error


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
    from impedance_modules.diagnosis.report.diagnosis_files import swallowed_object
    from impedance_modules.diagnosis.report.sentences import swallowed_sentences

    console.print(styled("[bold]{}[/bold]: {}", found.verdict, WORDS[found.verdict]))
    if found.reason:
        console.print(found.reason)
    if found.data is not None:
        for warning in found.data.warnings:
            console.print(styled("[yellow]note:[/yellow] {}", warning))
    if found.gaps:
        console.print(_gaps(found))
        quiet = [gap.joint for gap in found.gaps if _quiet(gap)]
        if quiet:
            console.print(f"reported velocities are those of the positions: {', '.join(quiet)}")
    _print_causes(found.causes, console)
    if found.small:
        console.print(f"small, within {100.0 * found.tolerance:.3g} % of the joints' torque ranges:")
        _print_causes(found.small, console)
    said = swallowed_sentences(swallowed_object(found.swallowed))
    if said:
        console.print(styled("taken up by stated deviations: {}", "; ".join(said)))
    _print_rollouts(found, console)
    if found.remainder.structure:
        console.print(f"remainder: {found.remainder.structure}")
    purpose = found.next_motion.get("purpose")
    if purpose and purpose != "none needed":
        console.print(f"next motion: to {purpose}: {found.next_motion.get('excitation')}")


def _print_rollouts(found: Diagnosis, console: Console) -> None:
    """Prints how far the simulation departs from the recordings, or why it was not run."""
    rollout = found.rollout
    if rollout.windows:
        console.print(_rollouts(found))
    for item in rollout.left_out:
        console.print(f"not simulated: {item.what}: {item.why}")


def _rollouts(found: Diagnosis) -> Table:
    from rich.table import Table

    rollout = found.rollout
    title = f"simulated again, {rollout.windows} x {rollout.window:g} s: rms error of position"
    table = Table(title=title)
    for name in ("joint", "before", "after", "refitted", "noise", "unit", "shrink"):
        table.add_column(name, justify="left" if name in ("joint", "unit") else "right")
    for joint, drift in rollout.position.items():
        shrink = _percent(drift.shrink, found)
        numbers = (f"{x:.3g}" for x in (drift.before, drift.after, drift.refitted, drift.noise_floor))
        table.add_row(joint, *numbers, drift.unit, shrink)
    return table


def _percent(shrink: float | None, found: Diagnosis) -> str:
    """A shrink in words; none without a gap, since of noise no part can be explained."""
    return "" if shrink is None or found.verdict == "no_gap" else f"{100 * shrink:.0f} %"


def _quiet(gap: JointGap) -> bool:
    """Whether a reported velocity is what the position's derivative says, about."""
    return gap.residual == "velocity" and gap.before < QUIET * gap.noise_floor


GAP_CAPTION = (
    "after: with the causes alone, as a patch has them; refitted: links, weights and stamps within priors too"
)


def _gaps(found: Diagnosis) -> Table:
    from rich.table import Table

    table = Table(title="held-out residual, rms", caption=GAP_CAPTION, caption_justify="left")
    for name in ("joint", "port", "before", "after", "refitted", "noise", "unit", "shrink"):
        table.add_column(name, justify="left" if name in ("joint", "port", "unit") else "right")
    for gap in found.gaps:
        if _quiet(gap):
            continue
        shrink = _percent(gap.shrink, found)
        numbers = (f"{x:.3g}" for x in (gap.before, gap.after, gap.refitted, gap.noise_floor))
        table.add_row(gap.joint, gap.residual, *numbers, gap.unit, shrink)
    return table


def _print_causes(causes: Sequence[Cause], console: Console) -> None:
    """Prints each cause with its numbers, a line each: names and units stay whole on a narrow terminal."""
    from impedance_modules.diagnosis.report.diagnosis_files import other_places

    likeliest = sorted(causes, key=lambda cause: (-(cause.probability or 0.0), -cause.weight))
    for rank, cause in enumerate(likeliest, start=1):
        carriers = ", ".join(cause.joints) or ", ".join(cause.parameters)
        likely = "" if cause.probability is None else f"{int(100 * cause.probability)} % likely, "
        alone = "" if cause.shrink is None else f", alone it closes {100 * cause.shrink:.0f} % of the gap"
        console.print(
            styled("{}. [bold]{}[/bold] on {}, {} port", rank, cause.effect, carriers, cause.port)
            + f": {likely}weight {cause.weight:.2f}{alone}"
        )
        for key, symbols in cause.parameters.items():
            numbers = (f"{symbol} {e.value:.4g} ± {e.std:.2g} {e.unit}" for symbol, e in symbols.items())
            console.print(f"   {key}: {', '.join(numbers)}", highlight=False)
        if cause.elsewhere:
            console.print(
                f"   as well at: {', '.join(other_places(cause)).replace('_', ' ')}", highlight=False
            )
        if cause.equivalent:
            others = ", ".join(f"{rival.effect} {' '.join(rival.joints)}" for rival in cause.equivalent)
            console.print(styled("   [yellow]or instead:[/yellow] {}", others))
