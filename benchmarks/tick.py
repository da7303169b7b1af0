# SPDX-License-Identifier: BSD-3-Clause
"""How long one control cycle takes, from state to filtered and paid torque, against pinocchio's bare floor.

The floor is what any such controller must ask of pinocchio: joint Jacobians, both hands' placements and Jacobians,
Coriolis torque. All cases alternate in random order within one run, because absolute times move by half from run to
run; the paced part sleeps between cycles, which leaves cold caches, as on a robot.

Usage: python benchmarks/tick.py TASK [TASK ...]
"""

from __future__ import annotations

import gc
import random
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.controller import Controller
from impedance_modules.robot.state import RobotState

ROUNDS, CALLS = 60, 60
PACED_CYCLES = 4000
STATES = 64
TOO_FAST = (1.0, 1.02, 1.05, 1.1, 1.2)
"""Speed of one joint over its limit: the first at which its velocity row acts against the task's own dampers."""


def states(assembly: Assembly, *, speed: float) -> list[RobotState]:
    """Small motions about the start, one joint at a part of its speed limit."""
    rng = np.random.default_rng(0)
    n, posture = assembly.model.n, assembly.modules.posture
    found = []
    for k in range(STATES):
        v = 1e-3 * rng.normal(size=n)
        v[1] = speed * assembly.limits.velocity_max[1]
        found.append(RobotState(k * assembly.period, posture + 1e-5 * rng.normal(size=n), v, np.zeros(n)))
    return found


def controller_of(assembly: Assembly) -> Controller:
    """A warm controller at the task's start."""
    controller = Controller(assembly)
    controller.warm()
    still = RobotState(0.0, assembly.modules.posture, np.zeros(assembly.model.n), np.zeros(assembly.model.n))
    controller.start(FirstState(still, np.zeros(assembly.model.n)), assembly.task.phases[0])
    return controller


def floor_of(assembly: Assembly, around: list[RobotState]) -> Callable[[int], None]:
    """What any such controller must ask of pinocchio."""
    model = assembly.model.pin_model
    data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    hands = [assembly.model.frame_id(arm.limb.hand) for arm in assembly.modules.arms]

    def floor(k: int) -> None:
        state = around[k % STATES]
        pin.computeJointJacobians(model, data, state.position)
        for hand in hands:
            pin.updateFramePlacement(model, data, hand)
        for hand in hands:
            pin.getFrameJacobian(model, data, hand, axes)
        pin.nonLinearEffects(model, data, state.position, state.velocity)

    return floor


def tick_of(controller: Controller, around: list[RobotState]) -> Callable[[int], None]:
    """One whole cycle, from state to torque."""

    def tick(k: int) -> None:
        if controller.tick(around[k % STATES]) or not controller.solved:
            raise SystemExit(f"no torque: {controller.solution}")

    return tick


def timed(cases: dict[str, Callable[[int], None]]) -> dict[str, np.ndarray]:
    """Microseconds per call of every case, blocks in random order."""
    times: dict[str, list[int]] = {name: [] for name in cases}
    order = random.Random(0)
    for _ in range(ROUNDS):
        names = list(cases)
        order.shuffle(names)
        for name in names:
            call = cases[name]
            for k in range(CALLS):
                began = time.perf_counter_ns()
                call(k)
                times[name].append(time.perf_counter_ns() - began)
    return {name: 1e-3 * np.array(values) for name, values in times.items()}


def paced(call: Callable[[int], None], period: float) -> np.ndarray:
    """Microseconds of work per cycle, sleeping in between; thread CPU time, so other jobs do not count."""
    values = []
    following = time.perf_counter()
    for k in range(PACED_CYCLES):
        began = time.thread_time_ns()
        call(k)
        values.append(time.thread_time_ns() - began)
        following += period
        time.sleep(max(0.0, following - time.perf_counter()))
    return 1e-3 * np.array(values)


def settled(assembly: Assembly, speed: float) -> tuple[Callable[[int], None], int]:
    """A controller that has ticked for a while, and how many rows act then."""
    controller, around = controller_of(assembly), states(assembly, speed=speed)
    call = tick_of(controller, around)
    for k in range(2 * STATES):
        call(k)
    return call, int(np.count_nonzero(controller.solution.active))


def limited(assembly: Assembly) -> tuple[Callable[[int], None], int]:
    """The slowest overspeed at which a row acts."""
    for speed in TOO_FAST:
        call, acting = settled(assembly, speed)
        if acting:
            return call, acting
    raise SystemExit("no row acts at any of the speeds")


def cases_of(task: str) -> tuple[dict[str, Callable[[int], None]], float]:
    """Floor and ticks of a task, without and with its robot's distance pairs; and the control period [s]."""
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
    collision = replace(assembly.robot.collision, pairs=())
    alone = replace(assembly, robot=replace(assembly.robot, collision=collision))
    cases = {"floor": floor_of(assembly, states(assembly, speed=0.0))}
    for name, which in (("", alone), (" + pairs", assembly)):
        call, _ = settled(which, 0.0)
        cases[f"tick{name}, no limit acts"] = call
        call, acting = limited(which)
        cases[f"tick{name}, {acting} row(s) act"] = call
    return cases, assembly.period


def report(times: dict[str, np.ndarray]) -> None:
    """Prints every case beside the floor."""
    floor = float(np.median(times["floor"]))
    for name, values in times.items():
        middle, *tail = np.percentile(values, [50, 99, 99.9, 100])
        print(
            f"  {name:32s} {middle:7.1f} us  {middle / floor:5.2f} x floor  p99 {tail[0]:6.0f}  "
            f"p99.9 {tail[1]:6.0f}  max {tail[2]:6.0f}"
        )


def main() -> None:
    """Times the tasks named on the command line."""
    gc.freeze()
    gc.disable()
    for task in sys.argv[1:]:
        cases, period = cases_of(task)
        print(f"{task}: back to back (wall time)")
        report(timed(cases))
        print(f"{task}: paced at {1.0 / period:.0f} Hz (CPU time)")
        report({name: paced(call, period) for name, call in cases.items() if "no limit" not in name})


if __name__ == "__main__":
    main()
