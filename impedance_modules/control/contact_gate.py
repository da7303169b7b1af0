# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a task that waits for contact may begin: a hand at rest, touching nothing, must feel next to nothing.

Contact is judged from measured effort against the model (``control.conditions``). What the model does not know of is
felt as a force at the hand: Baxter's springs beside s1 carry 20 N.m, and ``until: contact`` would be met at once.
So the same judge is asked before anything is sent:

    |w_i|  <  F / 2,      J^T w = g(q) + k (q - q_0) - \tau_s    (a robot at rest, F the smallest force waited for)
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.gates_types import Gate
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.conditions import Touch
from impedance_modules.modules.held_object import STANDARD_GRAVITY
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.patch import read_patch
from impedance_modules.spec.task import ContactCondition

Array = NDArray[np.float64]

SHARE = 0.5
"""Of the force that a phase waits for: the most that may be felt where nothing touches."""


def contact_gates(assembly: Assembly, state: RobotState) -> tuple[Gate, ...]:
    """Asks what the hands feel at rest; one answer per arm whose contact a phase of the task waits for.

    Args:
        assembly: The task, and the model that it is run with.
        state: Of the robot at rest.
    """
    awaited = _awaited(assembly)
    if not awaited:
        return ()
    kinematics = Kinematics(assembly.model, assembly.modules.frames)
    kinematics.update(state.position, state.velocity)
    touch = Touch(assembly.model, assembly.modules, kinematics, assembly.period)
    touch.reset(state)
    names = [arm.limb.name for arm in assembly.modules.arms]
    felt = {arm: float(np.linalg.norm(touch.wrench[names.index(arm), :3])) for arm in awaited}
    return tuple(_gate(assembly, state, arm, felt[arm], awaited[arm]) for arm in awaited)


def _awaited(assembly: Assembly) -> dict[str, tuple[str, float]]:
    """Finds, per arm, the phase that waits for the smallest force, and that force [N]."""
    arms = [arm.limb.name for arm in assembly.modules.arms]
    held = assembly.modules.held
    found: dict[str, tuple[str, float]] = {}
    for phase in assembly.task.phases:
        until = phase.until
        if not isinstance(until, ContactCondition):
            continue
        force = assembly.robot.contact_detection.force if until.force is None else until.force
        if until.target in arms:
            concerned = [arm for arm in arms if arm == until.target]
        else:
            concerned = arms if held is None else list(held.limbs)
        for arm in concerned:
            if arm not in found or force < found[arm][1]:
                found[arm] = phase.name, force
    return found


def _gate(assembly: Assembly, state: RobotState, arm: str, felt: float, awaited: tuple[str, float]) -> Gate:
    """Judges what one arm feels [N]; a hand that holds something may feel its weight."""
    phase, force = awaited
    held = assembly.modules.held
    carried = held.spec.mass * STANDARD_GRAVITY if held is not None and arm in held.limbs else 0.0
    name, found = f"contact {arm}", f"at rest the hand feels {felt:.1f} N"
    if felt < SHARE * force + carried:
        return Gate(name, True, found, "")
    joints = assembly.model.limbs[arm].joints
    expected = assembly.model.gravity(state.position)
    worst = int(joints[np.argmax(np.abs(state.effort - expected)[joints])])
    found += (
        f" where phase '{phase}' waits for {force:g} N: {assembly.model.joint_names[worst]} measures"
        f" {state.effort[worst]:.1f} N.m, the model expects {expected[worst]:.1f} N.m: contact would be found at once"
    )
    known = ", ".join(_patches_with_springs(assembly))
    remedy = (
        "nothing that touches the arm, and a model that knows what carries it: --effects with a patch"
        f" that a diagnosis of this robot has written{f', or {known}' if known else ''}"
    )
    return Gate(name, False, found, remedy)


def _patches_with_springs(assembly: Assembly) -> Iterator[str]:
    """Lists the robot folder's patches that know of springs beside the joints."""
    for path in sorted((assembly.robot.folder / "patches").glob("*.yaml")):
        if any(effect.effect == "parallel_spring" for effect in read_patch(path).effects):
            yield f"robots/{assembly.robot.name}/patches/{path.name}"
