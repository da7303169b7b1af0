# SPDX-License-Identifier: BSD-3-Clause
"""Writes a phase's gains and motions into the cycle's memory."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.memory import (
    BLEND_TIME,
    CLOCK,
    DURATION,
    GRIP,
    GRIP_START,
    LIFT,
    PERIOD,
    SHARE,
    CycleMemory,
    CycleSizes,
)
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.compiled_motion import COLUMNS, motion_table
from impedance_modules.modules.compiled_object import object_shares
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import PhaseMotion

Array = NDArray[np.float64]

BLENDING = 0.5
"""Gains of a phase come in by minimum jerk over this time [s], or over the phase if it is shorter; the forces of the
first one, and squeeze and weight of an object that nothing holds yet, always over this time."""


def cycle_sizes(modules: TaskModules, n: int, pairs: int, delay: int) -> CycleSizes:
    """Counts what a task's cycle holds."""
    return CycleSizes(
        joints=n,
        springs=sum(len(arm.springs) for arm in modules.arms),
        frames=len(modules.frames),
        limbs=len(modules.arms),
        pairs=pairs,
        hands=0 if modules.held is None else len(modules.held.hands),
        delay=delay,
    )


def write_fixed(memory: CycleMemory, modules: TaskModules, period: float, lag: float) -> None:
    """Writes what no phase changes: which frame a spring sits on, joint stiffness, the object's shares.

    ``lag`` is the time constant of the robot's velocity estimate [s] (``modules.motor_velocity``).
    """
    springs = [spring for arm in modules.arms for spring in arm.springs]
    memory.index("slots")[:] = [modules.frames.index(spring.frame) for spring in springs]
    for number, arm in enumerate(modules.arms):
        memory.index("limb_of_joint")[arm.limb.joints] = number
        if arm.bias is not None:
            memory["bias_stiffness"][arm.bias.joints] = arm.bias.stiffness
    shares = object_shares(modules.held, modules.frames)
    memory["squeeze"][:], memory["weight"][:] = shares.squeeze, shares.weight
    memory["grasp_turn"][:] = shares.turn
    memory.index("hand_slots")[:] = shares.slots
    memory["clock"][LIFT], memory["clock"][PERIOD] = shares.lift, period
    memory["clock"][SHARE] = 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0


def write_phase(
    memory: CycleMemory, modules: TaskModules, damping: Damping, motion: PhaseMotion, *, blend: bool
) -> None:
    """Begins a phase: its motion from clock 0, its gains blending in from those now in force.

    Args:
        memory: Of the run.
        modules: With the gains of the phase.
        damping: Designed for the phase.
        motion: From the equilibria where the last phase ended.
        blend: False for the first phase, whose gains hold at once, forces apart: every spring is relaxed then.
    """
    gains = _gains(modules, damping, memory.size.joints)
    for name, value in gains.items():
        memory[name][0] = memory[name][2] if blend else _at_start(name, value)
        memory[name][1] = value
    table = motion_table(modules, motion, memory.size.joints)
    memory.index("mover_count")[0] = len(table.movers)
    # A task of joint springs alone moves no spring; its empty table still has all columns.
    memory["movers"][: len(table.movers)] = table.movers.reshape(-1, COLUMNS)
    memory.index("rides")[:] = table.rides
    memory["offsets"][:] = table.offsets
    memory["rest_ends"][0], memory["rest_ends"][1] = table.rest_start, table.rest_goal
    memory["clock"][DURATION] = motion.duration
    memory["clock"][BLEND_TIME] = min(BLENDING, motion.duration) if blend else BLENDING
    memory["clock"][CLOCK] = 0.0
    memory["clock"][GRIP_START] = memory["clock"][GRIP]


def _at_start(name: str, value: Array) -> Array:
    """Forces come in smoothly even in the first phase; stiffness and damping of relaxed springs need not."""
    return np.zeros_like(value) if name == "force" else value


def _gains(modules: TaskModules, damping: Damping, n: int) -> dict[str, Array]:
    springs = [spring for arm in modules.arms for spring in arm.springs]
    joint_damping = np.zeros((n, n))
    for arm in modules.arms:
        if arm.bias is not None:
            joint_damping[np.ix_(arm.bias.joints, arm.bias.joints)] = damping.of_joints(arm.limb.name)
    count = len(springs)
    return {
        "stiffness": _stack([spring.in_world(spring.stiffness) for spring in springs], (count, 6, 6)),
        "damping": _stack([damping.of_spring(spring) for spring in springs], (count, 6, 6)),
        "force": _stack([spring.axis_force() for spring in springs], (count, 6)),
        "bias_damping": joint_damping,
    }


def _stack(values: list[Array], shape: tuple[int, ...]) -> Array:
    return np.array(values).reshape(shape)
