# SPDX-License-Identifier: BSD-3-Clause
"""What may be changed of a task before it runs: its scale, which arm takes part, where a path is taught."""

from __future__ import annotations

import math
from dataclasses import replace

from impedance_modules.errors import BadInput
from impedance_modules.spec.between_spec import BetweenSpec
from impedance_modules.spec.gripper_spec import GripperCondition
from impedance_modules.spec.hinge_spec import HINGE
from impedance_modules.spec.set_point_limits import SetPointLimits
from impedance_modules.spec.task import (
    ArmSpec,
    ContactCondition,
    HybridAxis,
    JointBiasSpec,
    PhaseSpec,
    SmoothCondition,
    SpringSpec,
    TaskSpec,
)


def as_taught(task: TaskSpec) -> TaskSpec:
    """Returns a task as its springs carry it out: one to be played back, on the surfaces it is taught on."""
    return task if task.playback is None else replace(task, environment=task.playback.taught_on)


def scaled(task: TaskSpec, scale: float) -> TaskSpec:
    """Multiplies every stiffness, damping and force of a task by ``scale``.

    Damping that follows from a ratio goes with zeta sqrt(K Lambda), so the ratio is multiplied by sqrt(scale). What a
    gripper is asked to hold with stays: half of it would drop what the task needs.

    Raises:
        BadInput: The scale is not in (0, 1].
    """
    if not 0.0 < scale <= 1.0:
        raise BadInput(f"--scale {scale}: a task can be made softer, not stiffer (valid: above 0, up to 1)")
    if scale == 1.0:
        return task
    held = task.object
    if held is not None:
        held = replace(held, squeeze=held.squeeze * scale)
    return replace(
        task,
        arms={name: _scaled_arm(arm, scale) for name, arm in task.arms.items()},
        object=held,
        phases=tuple(_scaled_phase(phase, scale) for phase in task.phases),
        between=tuple(_scaled_between(spring, scale) for spring in task.between),
        obstacles=tuple(
            replace(one, stiffness=one.stiffness * scale, damping=one.damping * scale)
            for one in task.obstacles
        ),
    )


def _ratio(value: float | None, scale: float) -> float | None:
    return None if value is None else value * math.sqrt(scale)


def _axis(axis: HybridAxis, scale: float) -> HybridAxis:
    """Force times scale at the same speed limit: its damping |force| / speed_limit scales along."""
    return replace(axis, force=axis.force * scale)


def _scaled_arm(arm: ArmSpec, scale: float) -> ArmSpec:
    bias = None if arm.joint_bias is None else _scaled_bias(arm.joint_bias, scale)
    return replace(arm, joint_bias=bias, springs=tuple(_scaled_spring(s, scale) for s in arm.springs))


def _scaled_bias(bias: JointBiasSpec, scale: float) -> JointBiasSpec:
    damping = bias.damping
    return replace(
        bias,
        stiffness={joint: value * scale for joint, value in bias.stiffness.items()},
        damping=None if damping is None else {joint: value * scale for joint, value in damping.items()},
        damping_ratio=_ratio(bias.damping_ratio, scale),
    )


def _scaled_spring(spring: SpringSpec, scale: float) -> SpringSpec:
    return replace(
        spring,
        stiffness=spring.stiffness * scale,
        damping=None if spring.damping is None else spring.damping * scale,
        damping_ratio=_ratio(spring.damping_ratio, scale),
        axes={name: _axis(axis, scale) for name, axis in spring.axes.items()},
    )


def _scaled_between(spring: BetweenSpec, scale: float) -> BetweenSpec:
    return replace(
        spring,
        stiffness=spring.stiffness * scale,
        damping=None if spring.damping is None else spring.damping * scale,
        damping_ratio=_ratio(spring.damping_ratio, scale),
    )


def _scaled_phase(phase: PhaseSpec, scale: float) -> PhaseSpec:
    return replace(
        phase,
        axes={
            target: {name: _axis(axis, scale) for name, axis in axes.items()}
            for target, axes in phase.axes.items()
        },
        stiffness={target: matrix * scale for target, matrix in phase.stiffness.items()},
    )


def single_arm(task: TaskSpec, arm: str) -> TaskSpec:
    """Reduces a task to one of its arms.

    Raises:
        BadInput: The task has no such arm, the arms hold an object together, or a condition needs the others.
    """
    if arm not in task.arms:
        raise BadInput(f"--arm {arm}: task '{task.name}' has no such arm (valid: {', '.join(task.arms)})")
    held = task.object
    if held is not None and set(held.held_by) != {arm}:
        holders = " and ".join(held.held_by)
        raise BadInput(f"--arm {arm}: {holders} hold the object of task '{task.name}' together")
    for spring in task.between:
        raise BadInput(
            f"--arm {arm}: the spring '{spring.name}' of task '{task.name}' is between '{spring.first.limb}' and"
            f" '{spring.second.limb}', one arm alone cannot stretch it (valid: the task with both arms)"
        )
    phases = tuple(_single_arm_phase(task, phase, arm) for phase in task.phases)
    pushes = tuple(push for push in task.pushes if push.target in {arm, "object"})
    guarded = ((one, tuple(guard for guard in one.guards if guard.limb == arm)) for one in task.obstacles)
    return replace(
        task,
        arms={arm: task.arms[arm]},
        phases=phases,
        pushes=pushes,
        set_points=_kept(task.set_points, arm),
        obstacles=tuple(replace(one, guards=guards) for one, guards in guarded if guards),
    )


def _kept(limits: SetPointLimits | None, arm: str) -> SetPointLimits | None:
    """Leaves the targets of the other arms out."""
    if limits is None:
        return None
    targets = {k: v for k, v in limits.targets.items() if k.startswith(("object", f"{arm}."))}
    return replace(limits, targets=targets)


def _single_arm_phase(task: TaskSpec, phase: PhaseSpec, arm: str) -> PhaseSpec:
    condition = phase.until
    if isinstance(condition, ContactCondition) and condition.target not in {None, "object", arm}:
        raise BadInput(
            f"--arm {arm}: phase '{phase.name}' of task '{task.name}' waits for a contact of '{condition.target}'"
        )
    if isinstance(condition, SmoothCondition) and condition.target != arm:
        raise BadInput(
            f"--arm {arm}: phase '{phase.name}' of task '{task.name}' waits for what '{condition.target}' rubs"
        )
    if isinstance(condition, GripperCondition) and set(condition.states) != {arm}:
        raise BadInput(
            f"--arm {arm}: phase '{phase.name}' of task '{task.name}' waits for the gripper of"
            f" {', '.join(condition.states)}"
        )
    own = ("object", HINGE, f"{arm}.")
    return replace(
        phase,
        equilibrium={k: v for k, v in phase.equilibrium.items() if k.startswith(own)},
        posture={k: v for k, v in phase.posture.items() if k == arm},
        axes={k: v for k, v in phase.axes.items() if k.startswith(own)},
        stiffness={k: v for k, v in phase.stiffness.items() if k.startswith(own)},
        listen=tuple(target for target in phase.listen if target.startswith(own)),
        submovements={k: v for k, v in phase.submovements.items() if k.startswith(own)},
        grippers={k: v for k, v in phase.grippers.items() if k == arm},
        paths={k: v for k, v in phase.paths.items() if k.startswith(own)},
    )
