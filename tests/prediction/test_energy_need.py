# SPDX-License-Identifier: BSD-3-Clause
"""The energy that ``check`` says a task needs, against what the noisy plant takes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.feasibility import TaskPrediction, refuse_infeasible
from tests.support.forecast_tasks import BOX, HOLD_AND_LIFT, wipe, write_task
from tests.support.paths import CHECKOUT


def prepared(
    path: Path, rate: float | None = None, arm: str | None = None
) -> tuple[Assembly, TaskPrediction]:
    assembly = assemble(str(path), effects=None, rate=rate, scale=1.0, arm=arm)
    return assembly, refuse_infeasible(assembly)


class Measured:
    """A task on the noisy plant: the least tank that would have done, and when its phases ended."""

    def __init__(self, assembly: Assembly) -> None:
        from impedance_modules.control.loop import Interrupt, run_loop
        from impedance_modules.control.supervisor import Supervisor
        from impedance_modules.runs.run_backends import sim_backend

        supervisor, backend = Supervisor(assembly), sim_backend(assembly, seed=1)
        first = backend.start()
        supervisor.start(first)
        controller = supervisor.controller
        self.need, self.effort = 0.0, np.zeros(assembly.model.n)

        def on_cycle(_state: object, effort: np.ndarray, _late: bool, _asked: bool) -> None:
            tank = controller.tank
            self.need = max(self.need, assembly.tank.initial - tank.level + assembly.tank.floor + tank.need)
            self.effort = effort.copy() if np.any(effort) else self.effort

        run_loop(
            supervisor,
            backend,
            first.state,
            on_cycle,
            Interrupt(),
            duration=None,
            paced=False,
            read_only=False,
        )
        self.ending = supervisor.ending
        self.charged = controller.tank.charged
        self.seconds = [seconds for _, seconds, _ in supervisor.sequence.ended]
        self.object_height = (
            None if backend.plant.object_pose is None else backend.plant.object_pose.translation[2]
        )


@pytest.mark.parametrize("name", ["hold-and-lift", "wipe", "box"])
def test_the_predicted_tank_is_what_the_run_needs(tmp_path: Path, name: str) -> None:
    """Need within 10 %, phases within 0.1 s, sensing within 30 %, torque at rest within 5 % of the largest."""
    texts = {"hold-and-lift": HOLD_AND_LIFT, "box": BOX}
    path = wipe(tmp_path) if name == "wipe" else write_task(tmp_path, texts[name])
    assembly, prediction = prepared(path)
    predicted, run = prediction.tank, Measured(assembly)
    assert run.ending.value == "done"
    assert predicted.need == pytest.approx(run.need, rel=0.1)
    expected = [phase.ended - phase.began for phase in prediction.motion.phases]
    assert run.seconds == pytest.approx(expected, abs=0.1)
    end_term = float(np.abs(prediction.motion.samples[-1].effort) @ assembly.tank.sensing_error)
    assert predicted.sensing - end_term == pytest.approx(run.charged, rel=0.3)
    last = prediction.motion.samples[-1].effort
    assert np.max(np.abs(run.effort - last)) < 0.05 * np.max(np.abs(last)) + 1.0
    # The parts are the whole.
    parts = sum(predicted.costs.values())
    assert parts == pytest.approx(predicted.need, abs=1e-6)


def test_a_tank_that_holds_the_need_does_not_slow_and_half_of_it_does(tmp_path: Path) -> None:
    assembly, prediction = prepared(write_task(tmp_path, HOLD_AND_LIFT))
    need = prediction.tank.need
    spare = need - assembly.tank.floor
    enough = write_task(tmp_path, HOLD_AND_LIFT, ("initial: 5", f"initial: {need + 0.15 * spare:.3f}"))
    short = tmp_path / "short"
    short.mkdir()
    starved = write_task(
        short, HOLD_AND_LIFT, ("initial: 5", f"initial: {assembly.tank.floor + 0.5 * spare:.3f}")
    )
    full = Measured(assemble(str(enough), effects=None, rate=None, scale=1.0, arm=None))
    slow = Measured(assemble(str(starved), effects=None, rate=None, scale=1.0, arm=None))
    assert sum(full.seconds) == pytest.approx(2.0, abs=0.01)
    assert slow.ending.value != "done" or sum(slow.seconds) > 2.05


def test_one_arm_scale_and_patch_are_taken_into_account(tmp_path: Path) -> None:
    path = write_task(tmp_path, HOLD_AND_LIFT)
    both = prepared(path)[1].tank.need
    assert prepared(path, arm="left")[1].tank.need < 0.8 * both
    soft = assemble(str(path), effects=None, rate=None, scale=0.3, arm=None)
    assert refuse_infeasible(soft).tank.need < 0.9 * both
    patch = CHECKOUT / "robots" / "baxter" / "patches" / "without-reflected-inertia.yaml"
    light = assemble(str(path), effects=patch, rate=None, scale=1.0, arm=None)
    moving = refuse_infeasible(light).tank.costs["arms moving"]
    assert moving < 0.8 * prepared(path)[1].tank.costs["arms moving"]
