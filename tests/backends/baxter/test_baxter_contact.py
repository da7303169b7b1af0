# SPDX-License-Identifier: BSD-3-Clause
"""A task that waits for contact, on a robot with springs beside its shoulders: refused until the model knows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.baxter.preflight_checks import refuse_closed
from impedance_modules.backends.baxter.simulator.parameters import SPRINGS
from impedance_modules.backends.baxter.simulator.push import Push
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.contact_gate import contact_gates
from impedance_modules.errors import RobotRefused
from impedance_modules.runs.execution import RunResult
from impedance_modules.spec.locate import find_task
from tests.support.baxter_lockstep import LockstepDouble, run_on_the_double

RATE = 200.0
PATCH = Path("robots/baxter/patches/counterbalance-springs.yaml")


def feeling(folder: Path, *, springs_known: bool) -> Assembly:
    """``touch-and-stop``, two seconds of feeling long, and nothing there to be felt."""
    text = find_task("touch-and-stop").read_text()
    task = folder / "feel.yaml"
    task.write_text(text.replace("duration: 6,", "duration: 2,"))
    assert task.read_text() != text
    effects = PATCH if springs_known else None
    return assemble(str(task), effects=effects, rate=RATE, scale=1.0, arm=None)


def at_rest(assembly: Assembly, effects: Path | None = None, springs=SPRINGS) -> LockstepDouble:
    double = LockstepDouble(str(assembly.task.path), RATE, effects, 3, springs)
    for _ in range(50):
        double.read()
    return double


def test_a_robot_whose_springs_the_model_lacks_is_refused_with_the_remedy(tmp_path: Path) -> None:
    assembly = feeling(tmp_path, springs_known=False)
    gates = contact_gates(assembly, at_rest(assembly).read())
    with pytest.raises(RobotRefused, match=r"right_s1 measures .* --effects .*counterbalance-springs.yaml"):
        refuse_closed(gates, commanding=True)
    # Springs of other numbers than the patch's, and exactly the patch's.
    known = feeling(tmp_path, springs_known=True)
    for double in (at_rest(known), at_rest(known, effects=PATCH, springs={})):
        (gate,) = contact_gates(known, double.read())
        assert gate.passed, gate


def test_a_task_that_waits_for_no_contact_is_not_asked() -> None:
    assembly = assemble("soft-hold", effects=None, rate=RATE, scale=1.0, arm=None)
    assert contact_gates(assembly, at_rest(assembly).read()) == ()


def feel(assembly: Assembly, out: Path, push: float = 0.0) -> RunResult:
    def meet(double: LockstepDouble) -> None:
        # Somebody lays a hand under the palm half a second from now; the robot takes it for no collision.
        double.robot.suppressions["right"].ask("suppress_contact_safety", 60.0)
        if push:
            double.when(0.5, lambda: double.robot.pushes.update(right=Push(np.array([0.0, 0.0, push]), 60.0)))

    return run_on_the_double(assembly, out, prepare=meet)[0]


def test_contact_is_felt_where_it_is_and_not_in_the_springs(tmp_path: Path) -> None:
    known = feeling(tmp_path, springs_known=True)
    nothing = feel(known, tmp_path / "nothing")
    assert "no contact within its 2 s" in nothing.reason
    pushed = feel(known, tmp_path / "pushed", push=9.0)
    ended = {phase["name"]: phase["seconds"] for phase in pushed.summary["phases"]}
    assert 0.4 < ended["feel"] < 0.8, pushed.summary["phases"]
    unknown = feel(feeling(tmp_path, springs_known=False), tmp_path / "unknown")
    ended = {phase["name"]: phase["seconds"] for phase in unknown.summary["phases"]}
    assert ended["feel"] < 0.2
