# SPDX-License-Identifier: BSD-3-Clause
"""The compiled control cycle equals the clear one for hundreds of cycles: phases, blends, starvation, stops."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.memory import EFFORT_NOT_FINITE, STATE_NOT_FINITE
from impedance_modules.robot.state import RobotState
from tests.support.clear_controller import ClearController
from tests.support.paths import TESTS

HERE = TESTS
EVERY_KEY = HERE / "data" / "every-key.yaml"
SIX_JOINTS = HERE / "robots" / "six_joint_pair"

PAIR_TASK = f"""
format: 1
name: six-joint-pair
robot: {SIX_JOINTS}
arms:
  port:
    posture: {{turn: 0.13236, lift: 0.97313, bend: -1.85784, roll: -1.67345, tilt: 1.65450, spin: 0.68178}}
    joint_bias: {{stiffness: {{turn: 5, lift: 5, bend: 5, roll: 1, tilt: 1, spin: 1}}, damping_ratio: 0.5}}
    springs:
      - name: palm
        frame: port_palm
        expressed_in: world
        stiffness: {{x: 300, y: 200, z: 100, rx: 10, ry: 10, rz: 10}}
        damping_ratio: 0.7
        axes: {{z: {{force: -6, speed_limit: 0.1}}}}
  starboard: {{mirror: port}}
object:
  {{held_by: [port, starboard], shape: box, mass: 1.0, size: [0.2, 0.3, 0.2], grasp: weld, squeeze: {{force: 10}}}}
safety: {{tank: {{initial: TANK, max: 10, floor: 0.2}}}}
phases:
  - {{name: down, duration: 0.4, equilibrium: {{object: {{z: 0.80}}}}, otherwise: next, until: {{contact: true}}}}
  - name: turn
    duration: 0.3
    stiffness: {{port.palm: {{x: 100, y: 100, z: 50, rx: 4, ry: 4, rz: 4}}}}
    equilibrium: {{object: {{x: 0.4, rz: 0.3}}}}
    posture: {{port: {{turn: 0.2}}}}
  - {{name: swing, duration: 0.5, equilibrium: {{object: {{y: {{sine: {{amplitude: 0.05, frequency: 2}}}}}}}}}}
"""


@cache
def pair_assembly(folder: Path, tank: float) -> Assembly:
    path = folder / f"pair-{tank}.yaml"
    path.write_text(PAIR_TASK.replace("TANK", str(tank)))
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


@cache
def baxter_assembly(folder: Path, tank: float) -> Assembly:
    path = folder / f"every-{tank}.yaml"
    text = EVERY_KEY.read_text().replace("initial: 5", f"initial: {tank}")
    path.write_text(
        text.replace("duration: 2.0", "duration: 0.4").replace("duration: 1\n", "duration: 0.3\n")
    )
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


class Motion:
    """Random smooth states about the start posture; the measured torque winds the elastic joints."""

    def __init__(self, assembly: Assembly, seed: int, size: float) -> None:
        random = np.random.default_rng(seed)
        n = assembly.model.n
        self.start, self.size = assembly.modules.posture, size * random.uniform(0.3, 1.0, n)
        self.rate, self.phase = random.uniform(0.5, 6.0, n), random.uniform(0.0, 6.0, n)
        self.pull, self.beat = 3.0 * random.normal(size=n), random.uniform(1.0, 10.0, n)
        self.random, self.period = random, assembly.period

    def state(self, k: int) -> RobotState:
        t = k * self.period
        swing = np.sin(self.rate * t + self.phase) - np.sin(self.phase)
        q = self.start + self.size * swing + 1e-5 * self.random.normal(size=self.start.size)
        v = self.size * self.rate * np.cos(self.rate * t + self.phase)
        return RobotState(t, q, v, self.pull * np.sin(self.beat * t))


def agree(fast: Controller, clear: ClearController, sent: np.ndarray, k: int) -> None:
    np.testing.assert_allclose(fast.memory["desired"], clear.desired, rtol=1e-8, atol=1e-8, err_msg=f"{k}")
    np.testing.assert_allclose(fast.solution.effort, clear.filtered, rtol=1e-7, atol=1e-7, err_msg=f"{k}")
    np.testing.assert_allclose(fast.effort, sent, rtol=1e-7, atol=1e-7, err_msg=f"{k}")
    tank, other = fast.tank, clear.tank
    numbers = ("level", "potential", "spring_scale", "need", "work", "charged", "starved_time", "spilled")
    for name in numbers:
        assert getattr(tank, name) == pytest.approx(getattr(other, name), rel=1e-7, abs=1e-8), (name, k)
    np.testing.assert_allclose(tank.pending, other.pending, rtol=1e-7, atol=1e-7)
    if fast.granted != clear.granted:
        # Whether a motion that costs nothing is granted by an empty tank is decided by the last bit.
        here, there = (clear._potential(clear.position, clock) for clock in (fast.clock, clear.clock))
        assert abs(here - there) < 1e-9
        clear.clock, clear.granted = fast.clock, fast.granted
    assert fast.clock == pytest.approx(clear.clock, abs=1e-12)
    assert fast.too_fast == (other.overspeed[0] if other.overspeed else fast.assembly.model.n)


def live(
    assembly: Assembly, seed: int, *, size: float, cycles: int, lane: bool, blind: float = 0.02
) -> set[str]:
    """Runs both through the task's phases; ``blind`` is the share of missed cycles. Returns what happened."""
    fast, clear, motion = Controller(assembly), ClearController(assembly), Motion(assembly, seed, size)
    if not lane:
        fast.solver.name = "another"  # the instance's: the lane is for the default solver only
    random, seen = np.random.default_rng(seed), set()
    n = assembly.model.n
    first = FirstState(motion.state(0), 0.3 * random.normal(size=n))
    phases = iter(assembly.task.phases)
    phase = next(phases)
    fast.start(first, phase)
    clear.start(first, phase)
    for k in range(cycles):
        if k and random.random() < blind:
            fast.miss()
            clear.miss()
            seen.add("missed")
            continue
        state = motion.state(k)
        assert fast.tick(state) == 0
        agree(fast, clear, clear.tick(state), k)
        seen |= {"limited"} if fast.solution.active.any() else set()
        seen |= {"slowed"} if 0.0 < fast.granted < 1.0 else {"halted"} if fast.granted == 0.0 else set()
        seen |= {"relaxed"} if fast.spring_scale < 1.0 else set()
        seen |= {"scaled"} if fast.paid < 1.0 else set()
        if fast.clock >= phase.duration or k % 170 == 169:
            phase = next(phases, phase)
            fast.next_phase(phase)
            clear.next_phase(phase)
            seen.add(phase.name)
    return seen


@pytest.mark.parametrize("lane", [True, False])
def test_two_arms_with_every_key_agree(tmp_path_factory, lane: bool) -> None:
    folder = tmp_path_factory.mktemp("tasks")
    seen = live(baxter_assembly(folder, 9.0), 1, size=0.04, cycles=400, lane=lane)
    assert {"press", "slide", "missed", "limited"} <= seen


def test_another_robot_agrees(tmp_path_factory) -> None:
    seen = live(pair_assembly(tmp_path_factory.mktemp("tasks"), 6.0), 2, size=0.03, cycles=500, lane=True)
    assert {"turn", "swing", "missed"} <= seen


def test_starved_tanks_agree(tmp_path_factory) -> None:
    """A small tank, and so many missed cycles that some are never made up for: motions are granted in part."""
    assembly = pair_assembly(tmp_path_factory.mktemp("tasks"), 0.6)
    seen: set[str] = set()
    for seed in (10, 11, 12):
        seen |= live(assembly, seed, size=0.05, cycles=250, lane=True, blind=0.7)
    assert {"relaxed", "scaled"} <= seen
    assert seen & {"slowed", "halted"}


def test_states_that_are_not_finite_book_and_send_nothing(tmp_path_factory) -> None:
    assembly = pair_assembly(tmp_path_factory.mktemp("tasks"), 6.0)
    fast, motion = Controller(assembly), Motion(assembly, 3, 0.03)
    fast.start(FirstState(motion.state(0), np.zeros(assembly.model.n)), assembly.task.phases[0])
    assert fast.tick(motion.state(0)) == 0
    before = fast.memory["book_scalars"].copy()
    for name in ("position", "velocity", "effort"):
        for bad in (np.nan, np.inf):
            values = {key: getattr(motion.state(1), key).copy() for key in ("position", "velocity", "effort")}
            values[name][2] = bad
            assert fast.tick(RobotState(0.001, **values)) == STATE_NOT_FINITE
            assert not fast.solved
            assert fast.solution is None
    assert np.array_equal(fast.memory["book_scalars"], before)
    huge = motion.state(2)
    assert fast.tick(RobotState(0.002, huge.position, np.full_like(huge.velocity, 1e307), huge.effort)) in {
        0,
        EFFORT_NOT_FINITE,
    }


@pytest.mark.parametrize("lane", [True, False])
def test_a_cycle_that_filters_nothing_reports_no_change(tmp_path_factory, lane: bool) -> None:
    """A state that is not finite or missing, and a stop, have no answer of the filter: the last one's is not theirs."""
    assembly = pair_assembly(tmp_path_factory.mktemp("tasks"), 6.0)
    if not lane:
        assembly = replace(assembly, robot=replace(assembly.robot, solver="proxsuite"))
    still = np.zeros(assembly.model.n)
    at_rest = RobotState(0.0, assembly.modules.posture, still, still)
    fast = still.copy()
    fast[1] = 1.2 * assembly.limits.velocity_max[1]
    too_fast = RobotState(0.001, at_rest.position, fast, still)
    lost = replace(too_fast, velocity=np.full_like(fast, np.nan))
    for ends in (lambda c: c.tick(lost), lambda c: c.miss(), lambda c: c.brake(at_rest, still)):
        controller = Controller(assembly)
        controller.start(FirstState(at_rest, still), assembly.task.phases[0])
        assert controller.tick(too_fast) == 0
        assert controller.changed
        assert controller.acting > 0
        ends(controller)
        assert not controller.changed
        assert controller.acting == 0
        assert controller.solution is None


def test_same_states_give_the_same_bits(tmp_path_factory) -> None:
    assembly = pair_assembly(tmp_path_factory.mktemp("tasks"), 2.0)
    runs = []
    for _ in range(2):
        fast, motion = Controller(assembly), Motion(assembly, 4, 0.08)
        fast.warm()
        fast.start(FirstState(motion.state(0), np.zeros(assembly.model.n)), assembly.task.phases[0])
        efforts = []
        for k in range(200):
            assert fast.tick(motion.state(k)) == 0
            efforts.append(fast.effort.copy())
        runs.append(np.array(efforts))
    assert np.array_equal(runs[0], runs[1])
