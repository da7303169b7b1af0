# SPDX-License-Identifier: BSD-3-Clause
"""``run`` and ``check`` with ``--compensate``, as a user gives them: files, figures, and refusals with their place."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.prediction.feasibility import refuse_infeasible
from tests.control.test_compensation_on_the_plant import Ran
from tests.support.baxter_lockstep import run_in_lockstep
from tests.support.commands import invoke, refusal
from tests.support.effect_recordings import AppliedEffect, applied, write_patch
from tests.support.paths import CHECKOUT
from tests.support.swaying_arm import swaying

TASK = swaying(initial=2.5, most=8, amplitude=0.05, seconds=1.5)

RATE = 200

PAYLOAD = applied("payload", "link", "right_hand", m=0.5, cx=0.0, cy=0.0, cz=0.05)
FRICTION = applied("coulomb_friction", "actuator", "right_s0", fc=1.0)


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "sway.yaml"
    path.write_text(TASK)
    return path


def patch(folder: Path, *effects: AppliedEffect) -> Path:
    return write_patch(folder, *(effect.entry() for effect in effects), robot="baxter")


def tracking(out: Path) -> float:
    return float(json.loads((out / "summary.json").read_text())["hands"]["right_hand"]["tracking_rms"])


def test_run_compensates_records_and_verifies(task: Path, tmp_path: Path) -> None:
    diagnosed, errors = patch(tmp_path, PAYLOAD, FRICTION), {}
    for name, options in {
        "absent": (),
        "before": ("--effects", diagnosed),
        "after": ("--effects", diagnosed, "--compensate", diagnosed),
    }.items():
        out = tmp_path / name
        assert invoke("run", task, "--rate", RATE, *options, "--out", out).return_value == 0
        errors[name] = tracking(out)
    assert errors["after"] - errors["absent"] < 0.5 * (errors["before"] - errors["absent"])
    episode = read_episode(tmp_path / "after")
    assert episode.metadata["compensate"] == diagnosed.read_text()
    added = episode.extra["module.compensation.right_s0"]
    assert np.max(np.abs(added)) > 0.5
    assert "bit-equal" in invoke("replay", tmp_path / "after", "--verify").output
    assert "compensate" not in read_episode(tmp_path / "before").metadata


def test_check_states_torque_and_joules(task: Path, tmp_path: Path) -> None:
    """What it foretells the tank pays for friction, and the potential at the start, is what a run books."""
    diagnosed = patch(tmp_path, applied("coulomb_friction", "actuator", "right_s0", fc=3.0))
    printed = invoke("check", task, "--rate", RATE, "--effects", diagnosed, "--compensate", diagnosed).output
    assert "coulomb_friction" in printed and "friction and drives compensated" in printed
    options = {"rate": 500.0, "scale": 1.0, "arm": None}
    assembly = assemble(str(task), effects=diagnosed, compensate=diagnosed, **options)
    forecast = refuse_infeasible(assembly).compensation
    assert forecast is not None
    told = float(forecast.drawn[-1])
    with_friction, without = Ran(assembly), Ran(assemble(str(task), effects=None, **options))
    booked = with_friction.tank.work - without.tank.work
    assert told > 0.1
    assert told == pytest.approx(booked, rel=0.2)


def test_the_example_of_the_docs(tmp_path: Path) -> None:
    """Half a newton metre on seven joints at one radian per second empties five joules in a second and a half."""
    names = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
    diagnosed = patch(
        tmp_path, *(applied("coulomb_friction", "actuator", f"right_{name}", fc=0.5) for name in names)
    )
    (tmp_path / "turn.yaml").write_text(
        TASK.partition("    springs:")[0].replace("s0: 3", "s0: 90").replace(": 3", ": 60")
        + "safety: {tank: {initial: 60, max: 90, floor: 0.3}}\nphases:\n"
        "  - name: turn\n    duration: 1.5\n"
        "    posture: {right: {s0: 1.2, s1: -0.1, e0: 1.1, e1: 2.1, w0: 0.4, w1: 1.5, w2: 1}}\n"
    )
    assembly = assemble(
        str(tmp_path / "turn.yaml"), effects=None, compensate=diagnosed, rate=500.0, scale=1.0, arm=None
    )
    prediction = refuse_infeasible(assembly)
    assert prediction.compensation is not None
    first, last = prediction.motion.samples[0], prediction.motion.samples[-1]
    travelled = 0.5 * float(np.sum(np.abs(last.q - first.q)))
    assert float(prediction.compensation.drawn[-1]) == pytest.approx(travelled, rel=0.1)


def test_a_tank_that_cannot_pay_is_refused_at_its_line(task: Path, tmp_path: Path) -> None:
    task.write_text(TASK.replace("initial: 2.5", "initial: 0.7"))
    diagnosed = patch(tmp_path, applied("coulomb_friction", "actuator", "right_s0", fc=4.0))
    said = refusal("check", task, "--rate", RATE, "--compensate", diagnosed)
    line = 1 + next(k for k, text in enumerate(task.read_text().splitlines()) if "tank" in text)
    assert re.match(rf"{re.escape(str(task))}:{line}:\d+: safety\.tank\.initial: the task needs", said)
    assert "friction and drives compensated" in said
    assert said == refusal("run", task, "--rate", RATE, "--compensate", diagnosed, "--out", tmp_path / "no")
    assert not (tmp_path / "no").exists()


def test_a_torque_margin_that_is_gone_is_refused_at_the_patch(task: Path, tmp_path: Path) -> None:
    diagnosed = patch(tmp_path, FRICTION, applied("torque_offset", "link", "right_w1", c=20.0))
    said = refusal("check", task, "--rate", RATE, "--compensate", diagnosed)
    line = 1 + [k for k, text in enumerate(diagnosed.read_text().splitlines()) if "effect: " in text][1]
    assert (
        said.startswith(f"{diagnosed}:{line}:")
        and "effects[1].effect: with torque_offset compensated" in said
    )
    assert "whose limit is 15 N.m" in said


def test_an_effect_that_is_not_compensated_is_refused_by_name(task: Path, tmp_path: Path) -> None:
    diagnosed = patch(tmp_path, applied("backlash", "actuator", "right_s0", b=0.02))
    said = refusal("run", task, "--compensate", diagnosed)
    assert (
        said.startswith(f"{diagnosed}:")
        and "backlash is not compensated: while the motor crosses the gap" in said
    )


def test_a_patch_for_another_robot_is_refused(task: Path, tmp_path: Path) -> None:
    diagnosed = write_patch(tmp_path, FRICTION.entry(), robot="six_joint_pair")
    assert "the patch is for robot 'six_joint_pair'" in refusal("check", task, "--compensate", diagnosed)


def test_a_playback_is_not_compensated(tmp_path: Path) -> None:
    diagnosed = patch(tmp_path, FRICTION)
    said = refusal("check", CHECKOUT / "tasks/thesis/slide-over-position.yaml", "--compensate", diagnosed)
    assert "plays a joint path back" in said


def test_on_the_simulated_baxter_weight_and_friction_are_compensated(task: Path, tmp_path: Path) -> None:
    """Neither task nor model knows the effects: only the robot behind its messages has them."""
    diagnosed, errors = patch(tmp_path, PAYLOAD, FRICTION), {}
    for name, effects, compensate in (
        ("absent", None, None),
        ("before", diagnosed, None),
        ("after", diagnosed, diagnosed),
    ):
        assembly = assemble(
            str(task), effects=None, compensate=compensate, rate=float(RATE), scale=1.0, arm=None
        )
        result, _ = run_in_lockstep(assembly, tmp_path / name, effects=effects, springs={})
        assert result.summary["ending"] == "done", result.reason
        errors[name] = tracking(tmp_path / name)
    assert errors["after"] - errors["absent"] < 0.6 * (errors["before"] - errors["absent"])


def test_a_compensated_weight_is_no_contact(task: Path, tmp_path: Path) -> None:
    """The phase waits for 3 N; half a kilogram that the model does not know would be 5 N from the start."""
    waits = "\n  - {name: wait, duration: 0.5, until: {contact: {force: 3, time: 0.05}}, otherwise: next}\n"
    task.write_text(TASK.rstrip("\n") + waits)
    diagnosed, phases = patch(tmp_path, PAYLOAD), {}
    for name, compensate in (("before", None), ("after", diagnosed)):
        assembly = assemble(
            str(task), effects=None, compensate=compensate, rate=float(RATE), scale=1.0, arm=None
        )
        result, _ = run_in_lockstep(assembly, tmp_path / name, effects=diagnosed, springs={})
        phases[name] = {phase["name"]: phase["seconds"] for phase in result.summary["phases"]}
    assert phases["before"]["wait"] < 0.3
    assert phases["after"]["wait"] == pytest.approx(0.5, abs=0.02)
