# SPDX-License-Identifier: BSD-3-Clause
"""The control cycle: the same as Python and as machine code, through phases, starvation and gaps; what it reports."""

from copy import deepcopy
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.compiled import use_machine_code
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.cycle import EFFORT_NOT_FINITE, STATE_NOT_FINITE
from impedance_modules.robot.state import RobotState
from tests.support.paths import TESTS

EVERY_KEY = TESTS / "data" / "every-key.yaml"

PAIR_TASK = f"""
format: 1
name: six-joint-pair
robot: {TESTS / "robots" / "six_joint_pair"}
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


def assembled(path: Path, text: str) -> Assembly:
    path.write_text(text)
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


def pair_assembly(folder: Path, tank: float) -> Assembly:
    return assembled(folder / "pair.yaml", PAIR_TASK.replace("TANK", str(tank)))


def baxter_assembly(folder: Path, tank: float) -> Assembly:
    text = EVERY_KEY.read_text().replace("initial: 5", f"initial: {tank}")
    text = text.replace("duration: 2.0", "duration: 0.4").replace("duration: 1\n", "duration: 0.3\n")
    return assembled(folder / "every-key.yaml", text)


@pytest.fixture
def pair(tmp_path: Path) -> Assembly:
    return pair_assembly(tmp_path, 6.0)


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


def run_cycles(
    assembly: Assembly, seed: int, *, size: float, cycles: int, exact: bool, missing: float
) -> tuple[np.ndarray, set[str]]:
    """Goes through the task's phases: (cycles, ...) torque and ledger of every cycle, and what happened.

    ``size`` of the motion [rad]; ``exact``: the active-set solver is asked first, as by default; ``missing``: share of
    cycles without a state.
    """
    controller, motion = Controller(assembly), Motion(assembly, seed, size)
    if not exact:
        controller.solver.name = "another"
    random, seen, rows = np.random.default_rng(seed), set(), []
    first = FirstState(motion.state(0), 0.3 * random.normal(size=assembly.model.n))
    phases = iter(assembly.task.phases)
    phase = next(phases)
    controller.start(first, phase)
    cycle, tank = controller.cycle, controller.tank
    for k in range(cycles):
        if k and random.random() < missing:
            controller.miss()
            seen.add("missed")
        else:
            assert controller.tick(motion.state(k)) == 0
            happened = {
                "limited": controller.solution.active.any(),
                "slowed": cycle.admitted < 1.0,
                "relaxed": tank.spring_scale < 1.0,
                "scaled": cycle.effort_scale < 1.0,
            }
            seen |= {name for name, yes in happened.items() if yes}
        books = (tank.level, tank.potential, tank.spring_scale, tank.need, tank.work, tank.charged)
        vectors = (cycle.modules.desired, controller.effort, tank.pending.ravel())
        rows.append(np.concatenate([*vectors, books, [cycle.clock]]))
        if controller.clock >= phase.duration or k % 170 == 169:
            phase = next(phases, phase)
            controller.next_phase(phase)
            seen.add(phase.name)
    return np.array(rows), seen


def both(assembly: Assembly, seed: int, **how) -> set[str]:
    """Runs as Python and as machine code; the library functions of either may differ in the last bit."""
    use_machine_code(False)
    here, seen = run_cycles(assembly, seed, **how)
    use_machine_code(True)
    there, _ = run_cycles(assembly, seed, **how)
    np.testing.assert_allclose(here, there, rtol=1e-7, atol=1e-8)
    return seen


@pytest.mark.parametrize("exact", [True, False])
def test_two_arms_with_every_key_run_the_same_both_ways(tmp_path: Path, exact: bool) -> None:
    assembly = baxter_assembly(tmp_path, 9.0)
    seen = both(assembly, 1, size=0.04, cycles=360, exact=exact, missing=0.02)
    assert {"press", "slide", "missed", "limited"} <= seen


def test_another_robot_runs_the_same_both_ways(pair) -> None:
    seen = both(pair, 2, size=0.03, cycles=400, exact=True, missing=0.02)
    assert {"turn", "swing", "missed"} <= seen


def test_starved_tanks_run_the_same_both_ways(tmp_path: Path) -> None:
    """A small tank, and so many missed cycles that some are never made up for: motions are admitted in part."""
    assembly = pair_assembly(tmp_path, 0.6)
    seen: set[str] = set()
    for seed in (10, 11, 12):
        seen |= both(assembly, seed, size=0.05, cycles=250, exact=True, missing=0.7)
    assert {"relaxed", "scaled", "slowed"} <= seen


def started(assembly: Assembly, seed: int, size: float, acting: float = 0.0) -> tuple[Controller, Motion]:
    controller, motion = Controller(assembly), Motion(assembly, seed, size)
    first = FirstState(motion.state(0), np.full(assembly.model.n, acting))
    controller.start(first, assembly.task.phases[0])
    return controller, motion


def test_states_that_are_not_finite_book_and_send_nothing(pair) -> None:
    fast, motion = started(pair, 3, 0.03)
    assert fast.tick(motion.state(0)) == 0
    before = fast.tank.level, fast.tank.work, fast.tank.potential
    for name, bad in product(("position", "velocity", "effort"), (np.nan, np.inf)):
        state = deepcopy(motion.state(1))
        getattr(state, name)[2] = bad
        assert fast.tick(state) == STATE_NOT_FINITE
        assert not fast.solved
        assert fast.solution is None
    assert (fast.tank.level, fast.tank.work, fast.tank.potential) == before
    huge = replace(motion.state(2), velocity=np.full(pair.model.n, 1e307))
    assert fast.tick(huge) in {0, EFFORT_NOT_FINITE}


@pytest.mark.parametrize("solver", ["daqp", "proxsuite"])
def test_a_cycle_that_filters_nothing_reports_no_change(pair, solver: str) -> None:
    """A state that is not finite or missing, and a stop, have no answer of the filter: the last one's is not theirs."""
    assembly = replace(pair, robot=replace(pair.robot, solver=solver))
    still = np.zeros(assembly.model.n)
    at_rest = RobotState(0.0, assembly.modules.posture, still, still)
    fast = still.copy()
    fast[1] = 1.2 * assembly.limits.velocity_max[1]
    too_fast = RobotState(0.001, at_rest.position, fast, still)
    lost = replace(too_fast, velocity=np.full_like(fast, np.nan))
    for ends in (lambda c: c.tick(lost), lambda c: c.miss(), lambda c: c.brake(at_rest)):
        controller = Controller(assembly)
        controller.start(FirstState(at_rest, still), assembly.task.phases[0])
        assert controller.tick(too_fast) == 0
        assert controller.changed
        assert controller.active_rows > 0
        ends(controller)
        assert not controller.changed
        assert controller.active_rows == 0
        assert controller.solution is None


def test_same_states_give_the_same_bits(tmp_path: Path) -> None:
    assembly = pair_assembly(tmp_path, 2.0)
    efforts: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for warmed, found in efforts.items():
        controller, motion = started(assembly, 4, 0.08)
        if warmed:
            controller.warm()
        for k in range(200):
            assert controller.tick(motion.state(k)) == 0
            found.append(controller.effort.copy())
    assert np.array_equal(efforts[False], efforts[True])
