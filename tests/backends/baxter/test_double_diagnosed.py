# SPDX-License-Identifier: BSD-3-Clause
"""A double that differs from its model by something nobody told: run, recorded, diagnosed.

In process, and over a real ROS master.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from impedance_modules.backends.baxter.simulator.parameters import SPRINGS
from impedance_modules.control.assembly import assemble
from tests.backends.baxter.test_simulated_baxter_runs import ATTEMPTS, BUSY
from tests.support.baxter_lockstep import run_on_the_double
from tests.support.baxter_process import double, impedance
from tests.support.paths import TESTS

MOTIONS = [str(TESTS / "data" / f"swing-{name}.yaml") for name in ("one", "one", "two")]
"""The right arm only, every joint at once; the first twice, which tells the noise, the last held out."""

RATE = 200
WITHHELD = 2.0
"""Viscous friction in the elbow's drive [N.m.s/rad]; the model has none."""

PATCH = f"""
format: 1
robot: baxter
provenance: {{origin: hand, date: "2026-11-21", note: Withheld from task and diagnosis.}}
effects:
  - effect: viscous_friction
    joints: [right_e1]
    port: actuator
    parameters: {{right_e1: {{fv: {{value: {WITHHELD}, unit: N.m.s/rad}}}}}}
"""


@pytest.fixture
def patch(tmp_path: Path) -> Path:
    path = tmp_path / "withheld.yaml"
    path.write_text(PATCH)
    return path


def diagnosed(recordings: list[str], folder: Path) -> tuple[list[dict[str, Any]], str]:
    """Causes that are named, and what the terminal said."""
    one, again, held_out = recordings
    answer = folder / "answer.json"
    options = ("--robot", "baxter", "--json", str(answer))
    run = impedance("diagnose", one, again, "--holdout", held_out, *options, seconds=900.0)
    assert run.returncode in (0, 5, 6), run.stdout + run.stderr
    return json.loads(answer.read_text())["causes"], run.stdout


def check_the_answer(recordings: list[str], folder: Path) -> None:
    causes, said = diagnosed(recordings, folder)
    assert causes, said
    first = causes[0]
    assert (first["effect"], first["port"]) == ("viscous_friction", "actuator"), said
    assert "right_e1" in first["joints"]
    assert first["weight"] > 0.8
    assert first["parameters"]["right_e1"]["fv"]["value"] == pytest.approx(WITHHELD, rel=0.1)


def test_withheld_friction_and_springs_are_named_from_recordings_of_the_double(
    tmp_path: Path, patch: Path
) -> None:
    """The robot carries the springs beside s1 itself; nobody told the model of them."""
    recordings = []
    for k, motion in enumerate(MOTIONS):
        assembly = assemble(motion, effects=None, rate=RATE, scale=1.0, arm=None)
        out = tmp_path / f"recording-{k}"
        run_on_the_double(assembly, out, effects=patch, seed=k, springs=SPRINGS)
        recordings.append(str(out))
    causes, said = diagnosed(recordings, tmp_path)
    named = {(cause["effect"], joint): cause for cause in causes for joint in cause["joints"]}
    friction = named["viscous_friction", "right_e1"]["parameters"]["right_e1"]
    assert friction["fv"]["value"] == pytest.approx(WITHHELD, rel=0.1), said
    stiffness, preload = SPRINGS["s1"]
    spring = named["parallel_spring", "right_s1"]["parameters"]["right_s1"]
    assert spring["k"]["value"] == pytest.approx(stiffness, rel=0.1), said
    assert spring["preload"]["value"] == pytest.approx(preload, rel=0.1), said


def record(motion: str, out: Path) -> str:
    """Runs a motion on the double; again where a busy machine has made it give up."""
    for attempt in range(ATTEMPTS):
        out = out.with_name(f"{out.name}-try-{attempt}") if attempt else out
        options = ("--backend", "baxter", "--rate", str(RATE), "--approach", "--out", str(out))
        run = impedance("run", motion, *options)
        said = re.sub(r"\s+", " ", run.stdout + run.stderr)
        if run.returncode == 0:
            return str(out)
        assert BUSY.search(said), said
    raise AssertionError(said)


@pytest.mark.ros
def test_the_same_over_ros(master: str, tmp_path: Path, patch: Path) -> None:
    stands = ("--posture", MOTIONS[0], "--enabled", "--no-spring", "--effects", str(patch))
    with double(tmp_path, master, *stands):
        recordings = [record(motion, tmp_path / f"recording-{k}") for k, motion in enumerate(MOTIONS)]
    check_the_answer(recordings, tmp_path)
