# SPDX-License-Identifier: BSD-3-Clause
"""``impedance tune``: joint springs and a posture with which an arm carries a force stably."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.shared_options import task_argument
from impedance_modules.errors import BadInput, nearest

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.control.assembly import Assembly
    from impedance_modules.robot.model import RobotModel
    from impedance_modules.tools.spring_tuning import TunedPosture, TuningRequest, TuningResult

PATH = click.Path(path_type=Path)
AXES = {
    f"{sign}{name}": tuple(value if k == i else 0.0 for k in range(3))
    for sign, value in (("", 1.0), ("+", 1.0), ("-", -1.0))
    for i, name in enumerate("xyz")
}


@click.command("tune")
@task_argument
@click.option("--arm", metavar="NAME", help="Arm that carries the force  [default: the task's only one].")
@click.option(
    "--force", required=True, metavar="LO:HI", help="Force that the hand exerts, lowest to highest [N]."
)
@click.option(
    "--direction", required=True, metavar="AXIS", help="Of the force in world: x, -z ..., or X,Y,Z."
)
@click.option(
    "--postures",
    type=int,
    default=9,
    show_default=True,
    metavar="N",
    help="Compare N elbows; 1 keeps the task's.",
)
@click.option(
    "--reach",
    type=float,
    default=1.0,
    show_default=True,
    metavar="RAD",
    help="A joint spring's rest lies no farther from the posture.",
)
@click.option(
    "--softest",
    type=float,
    default=0.5,
    show_default=True,
    metavar="K",
    help="No joint spring is softer [N.m/rad], or a joint that the load does not turn would drift.",
)
@click.option(
    "--alone", is_flag=True, help="Leave the task's other springs out: the joints must do it alone."
)
@click.option(
    "--share",
    type=float,
    default=1.0,
    show_default=True,
    metavar="S",
    help="Multiply what is written; below 1 folds.",
)
@click.option("--out", type=PATH, metavar="F.yaml", help="Write the task with posture and joint springs.")
@click.option(
    "--trial", type=PATH, metavar="F.yaml", help="Write a task that tries it under the largest force."
)
@click.option("--json", "json_path", type=PATH, metavar="F", help="Write all postures as JSON.")
def tune_command(
    task: str,
    arm: str | None,
    force: str,
    direction: str,
    postures: int,
    reach: float,
    softest: float,
    alone: bool,
    share: float,
    out: Path | None,
    trial: Path | None,
    json_path: Path | None,
) -> int:
    """Find the least joint springs with which an arm of TASK does not fold, and the best elbow for them.

    The joint springs carry a force at the hand, anywhere in LO:HI. Below the stiffness found, K - Gamma is no longer
    positive definite: the links fold under the load. Exit: 0 found, 2 bad input or no posture can.
    """
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.control.assembly import assemble
    from impedance_modules.tools.spring_tuning import tune
    from impedance_modules.tools.tuned_task import trial_task, tuned_task

    if not 0.0 < share <= 10.0:
        raise BadInput(f"--share {share:g}: not a share of the springs (valid: above 0, up to 10)")
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
    question = _question(
        assembly, arm, force, direction, postures=postures, reach=reach, softest=softest, alone=alone
    )
    tuning = tune(assembly, question)
    texts = {
        path: write(task, assembly.model, question, tuning.best, share)
        for path, write in ((out, tuned_task), (trial, trial_task))
        if path is not None
    }
    if json_path is not None:
        texts[json_path] = json.dumps(_as_json(assembly.model, question, tuning), indent=1) + "\n"
    for path, text in texts.items():
        _write(path, text)
    _print(assembly.model, question, tuning, Terminal())
    return 0


def _question(
    assembly: Assembly,
    arm: str | None,
    force: str,
    direction: str,
    *,
    postures: int,
    reach: float,
    softest: float,
    alone: bool,
) -> TuningRequest:
    """Reads the options, or says what would be valid."""
    import numpy as np

    from impedance_modules.tools.spring_tuning import TuningRequest

    arms = tuple(assembly.task.arms)
    if arm is None and len(arms) > 1:
        raise BadInput(
            f"--arm is missing: task '{assembly.task.name}' has several (valid: {', '.join(arms)})"
        )
    chosen = arms[0] if arm is None else arm
    if chosen not in arms:
        raise BadInput(f"--arm {arm}: no such arm{nearest(chosen, arms)} (valid: {', '.join(arms)})")
    low, high = _numbers("--force", force, ":", "LO:HI in N, e.g. 0:25", 2)
    if low > high or low == high == 0.0:
        raise BadInput(
            f"--force {force}: no range of forces (valid: LO:HI in N, LO not above HI, not both 0)"
        )
    way = AXES.get(direction) or _numbers(
        "--direction", direction, ",", "x, -z, ... or X,Y,Z, e.g. 0,0.6,-0.8", 3
    )
    length = float(np.linalg.norm(way))
    if length == 0.0:
        raise BadInput(f"--direction {direction}: has no length (valid: x, -z, ... or X,Y,Z)")
    if not 1 <= postures <= 200:
        raise BadInput(f"--postures {postures}: cannot compare that many (valid: 1 to 200)")
    if not 0.0 < reach <= 6.3:
        raise BadInput(f"--reach {reach:g} rad: no such angle (valid: above 0, up to 6.3)")
    if not 0.0 < softest <= 1000.0:
        raise BadInput(f"--softest {softest:g} N.m/rad: no such spring (valid: above 0, up to 1000)")
    return TuningRequest(chosen, np.array(way) / length, low, high, postures, reach, softest, alone)


def _numbers(option: str, text: str, between: str, valid: str, count: int) -> tuple[float, ...]:
    import math

    try:
        found = tuple(float(part) for part in text.split(between))
    except ValueError:
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        raise BadInput(f"{option} {text}: not {count} numbers (valid: {valid})")
    return found


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror} (valid: a writable file)") from error


def _as_json(model: RobotModel, question: TuningRequest, tuning: TuningResult) -> dict[str, object]:
    names = model.limbs[question.arm].joint_names
    joints = model.limbs[question.arm].joints

    def one(tuned: TunedPosture) -> dict[str, object]:
        columns = (tuned.posture.q[joints], tuned.stiffness, tuned.torque, tuned.rest)
        return {
            "along": tuned.posture.along,
            "total": tuned.total,
            "folds_at": tuned.folds_at,
            "torque_share": tuned.share,
            "hand_stiffness": list(tuned.hand),
            "joints": {
                name: dict(zip(("posture", "stiffness", "torque", "rest"), map(float, values), strict=True))
                for name, values in zip(names, zip(*columns, strict=True), strict=True)
            },
        }

    return {
        "format": 1,
        "arm": question.arm,
        "direction": question.direction.tolist(),
        "force": list(question.ends),
        "best": one(tuning.best),
        "postures": [one(tuned) for tuned in tuning.found],
        "refused": {f"{along:.2f}": why for along, why in tuning.refused.items()},
    }


def _print(model: RobotModel, question: TuningRequest, tuning: TuningResult, console: Console) -> None:
    from rich.table import Table

    table = Table(title="postures with the hand in its place", title_justify="left")
    for name in (
        "elbow along rad",
        "sum of springs N.m/rad",
        "folds at share",
        "torque of limit",
        "hand N/m",
    ):
        table.add_column(name, justify="right")
    for tuned in tuning.found:
        chosen = tuned is tuning.best
        hand = " to ".join(f"{k:.0f}" for k in tuned.hand)
        cells = (
            f"{tuned.posture.along:+.2f}",
            f"{tuned.total:.1f}",
            f"{tuned.folds_at:.2f}",
            f"{tuned.share:.0%}",
            hand,
        )
        table.add_row(*cells, style="bold" if chosen else None)
    console.print(table)
    for along, why in tuning.refused.items():
        console.print(f"{along:+.2f} rad: {why}", highlight=False)
    limb, best = model.limbs[question.arm], tuning.best
    joints = Table(title=f"best: {best.posture.along:+.2f} rad from the task's posture", title_justify="left")
    for name in ("joint", "posture rad", "spring N.m/rad", "torque N.m", "rest rad"):
        joints.add_column(name, justify="right")
    for k, name in enumerate(limb.short_names):
        values = (best.posture.q[limb.joints][k], best.stiffness[k], best.torque[k], best.rest[k])
        joints.add_row(name, *(f"{value:.3f}" for value in values))
    console.print(joints)
    console.print(_verdict(best), highlight=False)


def _verdict(best: TunedPosture) -> str:
    if best.folds_at > 0.97:
        return "the least that does not fold: 5 % less does"
    if best.folds_at > 0.0:
        return (
            f"it would fold only at {best.folds_at:.0%} of this: the springs' rests set the rest of it"
            " (--reach lets them lie farther away)"
        )
    return "it does not fold however soft the joints are: the task's other springs hold it (--alone leaves them out)"
