# SPDX-License-Identifier: BSD-3-Clause
r"""Gains and equilibria along a phase's clock, and how far the clock may go: as far as the energy tank can pay.

A new equilibrium or gain at an unmoved robot costs its jump in potential, r (U(q; new) - U(q; old)). Where the tank
cannot pay for a whole period of the phase's motion, the largest part of it that it can pay for is admitted, found by
bisection, and the clock goes by that part: an empty tank slows a task down.

Gains g blend from the last phase's into the phase's own by minimum jerk s over the blending time T_b:

    g(t) = g_from + s(t / T_b) (g_to - g_from)

What set-points move in a phase that listens (``control.equilibrium_following``) is admitted after that, in the same
way, but it stops no clock: a set-point that the tank cannot pay is followed as far as it can be paid.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.control.equilibrium_following import (
    Following,
    following_nothing,
    place_step,
    prepare_step,
    take_step,
)
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import EquilibriumMotion, PhaseMotion, place_equilibria
from impedance_modules.modules.minimum_jerk import minimum_jerk
from impedance_modules.modules.sum import Modules, joint_damping_matrix, potential_energy
from impedance_modules.records import Array3, Flag, Matrix, Record, Scalar
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.safety.tank import Tank, admit, budget, change_cost

BLENDING = 0.5
"""Gains of a phase come in by minimum jerk over this time [s], or over the phase if it is shorter; the forces of the
first one, and squeeze and weight of an object that nothing holds yet, always over this time."""

TRIALS = 12
"""Bisections for the largest affordable part of a motion: a step of 1/4096."""


class SetPoints(Record):
    """What one phase asks of the modules.

    Attributes:
        motion: Of the equilibria.
        blend_time: T_b [s].
        blended: The gains in force are those of the phase.
        grip_from: Part of squeeze and carried weight in force when the phase began.
        stiffness_from, stiffness_to: (springs, 6, 6), like all gains in world axes.
        damping_from, damping_to: (springs, 6, 6).
        force_from, force_to: (springs, 6) of the hybrid axes.
        joint_damping_from, joint_damping_to: (n, n).
        between_from, between_to: (springs, 6, 6) dampers of the springs between arms, in their own axes.
        following: What follows set-points; inactive in a phase that does not listen.
    """

    motion: EquilibriumMotion
    blend_time: Scalar
    blended: Flag = False
    grip_from: Scalar
    stiffness_from: Array3
    stiffness_to: Array3
    damping_from: Array3
    damping_to: Array3
    force_from: Matrix
    force_to: Matrix
    joint_damping_from: Matrix
    joint_damping_to: Matrix
    between_from: Array3
    between_to: Array3
    following: Following


def blending_time(blend: float | None, duration: float) -> float:
    """T_b of a phase [s]: as the task states it, or half a second, or the whole of a shorter phase."""
    return min(BLENDING, duration) if blend is None else blend


def phase_set_points(
    modules: TaskModules,
    damping: Damping,
    motion: PhaseMotion,
    now: Modules,
    *,
    first: bool,
    blend: float | None = None,
    follow: Callable[[EquilibriumMotion], Following] | None = None,
) -> SetPoints:
    """Prepares a phase: its motion from clock 0, its gains blending in from those now in force.

    Args:
        modules: With the gains of the phase.
        damping: Designed for the phase.
        motion: From the equilibria where the last phase ended.
        now: What is in force.
        first: True for the first phase, whose gains hold at once, forces apart: every spring is relaxed then.
        blend: T_b as the phase states it [s]; None where it does not.
        follow: Makes what follows set-points in the motion as it is laid out; None in a phase that does not listen.
    """
    springs = [spring for arm in modules.arms for spring in arm.springs]
    count = len(springs)
    stiffness = np.array([spring.world_stiffness for spring in springs]).reshape(count, 6, 6)
    dampers = np.array([damping.of_spring(spring) for spring in springs]).reshape(count, 6, 6)
    force = np.array([spring.axis_force() for spring in springs]).reshape(count, 6)
    joint_damping = joint_damping_matrix(modules, damping, now.desired.size)
    relative = np.array([damping.of_between(spring) for spring in modules.between])
    relative = relative.reshape(len(modules.between), 6, 6)
    biased = [arm.bias.joints for arm in modules.arms if arm.bias is not None]
    laid_out = motion.lay_out(np.concatenate([np.zeros(0, dtype=np.int64), *biased]))
    return SetPoints(
        motion=laid_out,
        blend_time=BLENDING if first and blend is None else blending_time(blend, motion.duration),
        grip_from=now.loads.grip,
        stiffness_from=stiffness.copy() if first else now.springs.stiffness.copy(),
        stiffness_to=stiffness,
        damping_from=dampers.copy() if first else now.springs.damping.copy(),
        damping_to=dampers,
        force_from=np.zeros_like(force) if first else now.springs.force.copy(),
        force_to=force,
        joint_damping_from=joint_damping.copy() if first else now.bias.damping.copy(),
        joint_damping_to=joint_damping,
        between_from=relative.copy() if first else now.between.damping.copy(),
        between_to=relative,
        following=following_nothing() if follow is None else follow(laid_out),
    )


@compiled
def place(points: SetPoints, modules: Modules, clock: float) -> None:
    """Puts gains and equilibria in force as they are at a phase clock [s]."""
    blend_gains(points, modules, clock)
    place_equilibria(
        points.motion,
        clock,
        modules.equilibrium_rotation,
        modules.equilibrium_translation,
        modules.bias.rest,
    )


@compiled
def blend_gains(points: SetPoints, modules: Modules, clock: float) -> None:
    """Puts the gains in force that a phase clock [s] asks for: minimum jerk from the last phase's to this phase's."""
    if points.blended and clock >= points.blend_time:
        return
    part = minimum_jerk(clock / points.blend_time)
    springs = modules.springs
    _blend(points.stiffness_from.ravel(), points.stiffness_to.ravel(), part, springs.stiffness.ravel())
    _blend(points.damping_from.ravel(), points.damping_to.ravel(), part, springs.damping.ravel())
    _blend(points.force_from.ravel(), points.force_to.ravel(), part, springs.force.ravel())
    _blend(
        points.joint_damping_from.ravel(), points.joint_damping_to.ravel(), part, modules.bias.damping.ravel()
    )
    _blend(points.between_from.ravel(), points.between_to.ravel(), part, modules.between.damping.ravel())
    modules.loads.grip = points.grip_from + part * (1.0 - points.grip_from)
    points.blended = clock >= points.blend_time


@compiled
def _blend(first: Array, last: Array, part: float, now: Array) -> None:
    for k in range(now.size):
        now[k] = first[k] + part * (last[k] - first[k])


@compiled
def advance(
    points: SetPoints, modules: Modules, arms: ArmGeometry, tank: Tank, q: Array, clock: float
) -> float:
    """Advances the phase by one period, or by the part of it that the tank can pay for; books the change.

    Args:
        points: Of the phase.
        modules: Gains and equilibria are overwritten.
        arms: At the state.
        tank: After ``measure``.
        q: (n,) [rad].
        clock: Of the phase, before [s].

    Returns:
        The part in [0, 1] of the period by which the phase's clock went on.
    """
    admitted = _admit_most(points, modules, arms, tank, q, clock)
    if admitted == 0.0:
        tank.short = True
    following = points.following
    if following.active:
        prepare_step(following, points.blended)
        granted = _admit_most(points, modules, arms, tank, q, clock + admitted * tank.period)
        take_step(following, points.motion, granted)
    return admitted


@compiled
def _admit_most(
    points: SetPoints, modules: Modules, arms: ArmGeometry, tank: Tank, q: Array, clock: float
) -> float:
    """Admits the largest part in [0, 1] of a change that the tank can pay for, found by bisection.

    The change is that of a period of the phase's clock [s], or the step towards set-points while one is prepared. The
    arguments are those of ``advance``.
    """
    allowed = budget(tank)
    part, admitted, refused = 1.0, 0.0, 1.0
    potential = 0.0
    for _ in range(TRIALS + 1):
        _place_part(points, modules, tank, clock, part)
        potential = potential_energy(modules, arms, q)
        if change_cost(tank, potential) <= allowed:
            admitted = part
        else:
            refused = part
        if admitted == 1.0:
            break
        part = 0.5 * (admitted + refused)
    if admitted < 1.0:
        _place_part(points, modules, tank, clock, admitted)
        potential = potential_energy(modules, arms, q)
    admit(tank, potential)
    return admitted


@compiled
def _place_part(points: SetPoints, modules: Modules, tank: Tank, clock: float, part: float) -> None:
    """Puts in force what a part of the change changes."""
    if points.following.stepping:
        place_step(points.following, points.motion, modules, part)
        place(points, modules, clock)
    else:
        place(points, modules, clock + part * tank.period)
