# SPDX-License-Identifier: BSD-3-Clause
r"""The sum of all modules at one state: torque, energy, and who contributed what.

    \tau = \sum_springs J^T (w + F - D (V - V_d)) - K_j (q - q_0) - D_j (v - v_0)
           + \sum_between J^T (w_A, w_B) + \sum_obstacles J^T f + \sum_hands J^T (squeeze + weight) + \tau_c

Nothing is inverted and nothing is projected: impedances add (thesis eq. 4.28).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import (
    BetweenSprings,
    between_efforts,
    between_energies,
    lay_out_between,
)
from impedance_modules.modules.compensation import (
    COMPENSATION,
    Compensation,
    compensate,
    compensation_energy,
    no_compensation,
)
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion
from impedance_modules.modules.equilibrium_velocity import follow_equilibrium
from impedance_modules.modules.held_object import ObjectLoads, object_efforts, object_loads
from impedance_modules.modules.joint_bias import JointSprings, bias_efforts, bias_energy
from impedance_modules.modules.obstacle import (
    Obstacles,
    lay_out_obstacles,
    obstacle_efforts,
    obstacle_energies,
)
from impedance_modules.modules.own_module import OWN, OwnModule, OwnTorques, apply_own, own_torques
from impedance_modules.modules.spring import Spring, Springs, spring_efforts, spring_energies
from impedance_modules.modules.target_motion import TargetMotion, target_motion
from impedance_modules.records import Array3, Matrix, Record, Vector
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.spec.task import EQUILIBRIUM


class Modules(Record):
    """All modules of a task as they are in force now, and what they ask for.

    Attributes:
        springs, bias, loads: Of every arm and of the object; their torques are rows of ``efforts``.
        between: Springs between two arms, likewise.
        obstacles: That push frames away.
        equilibrium_rotation, equilibrium_translation: (springs + between, 3, 3), (springs + between, 3) where all of
            them rest; ``springs`` and ``between`` have their rows of it [m].
        targets: How fast equilibria move, for dampers that count from them.
        own: Modules that somebody wrote in Python.
        compensation: Of what was diagnosed; inactive where nothing is to be compensated.
        efforts: (springs + arms + 2 + between + obstacles, n) torque of every spring, every arm's joint bias, squeeze
            and weight, every spring between arms, every obstacle, one row more for each module of ``own``, and one for
            what is compensated, if anything is [N.m].
        desired: (n,) their sum [N.m].
    """

    springs: Springs
    bias: JointSprings
    loads: ObjectLoads
    between: BetweenSprings
    obstacles: Obstacles
    equilibrium_rotation: Array3
    equilibrium_translation: Matrix
    targets: TargetMotion
    own: OwnTorques
    compensation: Compensation
    efforts: Matrix
    desired: Vector


@compiled
def potential_energy(modules: Modules, arms: ArmGeometry, q: Array) -> float:
    """Returns U of all springs, joint springs and compensated potentials as they are in force, undiminished [J]."""
    energy = spring_energies(modules.springs, arms) + bias_energy(modules.bias, q)
    energy += between_energies(modules.between, arms)
    energy += obstacle_energies(modules.obstacles, arms)
    if modules.own.active:
        energy += modules.own.energy
    if modules.compensation.active:
        energy += compensation_energy(modules.compensation, q)
    return energy


@compiled
def sum_modules(modules: Modules, arms: ArmGeometry, q: Array, velocity: Array, scale: float) -> float:
    """Writes every module's torque and their sum; returns the energy of the relaxed springs [J].

    Args:
        modules: In force.
        arms: At the state.
        q: (n,) [rad].
        velocity: (n,) that dampers act on [rad/s]: the motors', see ``modules.motor_velocity``.
        scale: Part in [0, 1] of the springs' potential that the energy tank leaves in force.
    """
    energy = spring_efforts(modules.springs, arms, velocity, scale)
    energy += bias_efforts(modules.bias, arms, q, velocity, scale)
    object_efforts(modules.loads, arms)
    energy += between_efforts(modules.between, arms, velocity, scale)
    energy += obstacle_efforts(modules.obstacles, arms, velocity, scale)
    if modules.own.active:
        energy += apply_own(modules.own, scale)
    added = modules.compensation
    rows = modules.efforts.shape[0] - (1 if added.active else 0)
    for j in range(q.size):
        modules.desired[j] = 0.0
        for k in range(rows):
            modules.desired[j] += modules.efforts[k, j]
    if added.active:
        follow_equilibrium(added.motion, modules.springs, modules.bias, arms)
        compensate(added, modules.desired, q, scale)
        for j in range(q.size):
            modules.efforts[rows, j] = added.effort[j]
            modules.desired[j] += added.effort[j]
    return energy


def lay_out(
    modules: TaskModules,
    n: int,
    compensation: Compensation | None = None,
    *,
    period: float = 1.0,
    own: int = 0,
) -> Modules:
    """Takes the memory of a task's modules once and writes what no phase changes; gains and equilibria are 0.

    Args:
        modules: Of the task.
        n: Number of the robot's joints.
        compensation: Of what was diagnosed; None for nothing.
        period: Of the control [s]; only ``measure_target_motion`` needs it.
        own: Number of modules that somebody wrote in Python.
    """
    springs = [spring for arm in modules.arms for spring in arm.springs]
    count, arms = len(springs), len(modules.arms)
    between = count + arms + 2
    guarded = between + len(modules.between)
    known = guarded + len(modules.obstacles)
    rotation = np.zeros((count + len(modules.between), 3, 3))
    translation = np.zeros((count + len(modules.between), 3))
    efforts = np.zeros((known + own + (0 if compensation is None else 1), n))
    stiffness, limb = np.zeros(n), np.zeros(n, dtype=np.int64)
    for number, arm in enumerate(modules.arms):
        limb[arm.limb.joints] = number
        if arm.bias is not None:
            stiffness[arm.bias.joints] = arm.bias.stiffness
    return Modules(
        springs=Springs(
            stiffness=np.zeros((count, 6, 6)),
            damping=np.zeros((count, 6, 6)),
            force=np.zeros((count, 6)),
            frame=np.array([modules.frames.index(spring.frame) for spring in springs], dtype=np.int64),
            target_rotation=rotation[:count],
            target_translation=translation[:count],
            target_twist=np.zeros((count, 6)),
            wrench=np.zeros((count, 6)),
            effort=efforts[:count],
        ),
        bias=JointSprings(
            stiffness=stiffness,
            damping=np.zeros((n, n)),
            rest=np.zeros(n),
            rest_velocity=np.zeros(n),
            limb=limb,
            effort=efforts[count : count + arms],
        ),
        loads=object_loads(modules.held, modules.frames, efforts[count + arms : count + arms + 2]),
        between=lay_out_between(
            modules.between, modules.frames, (rotation[count:], translation[count:]), efforts[between:guarded]
        ),
        obstacles=lay_out_obstacles(modules.obstacles, modules.frames, efforts[guarded:known]),
        equilibrium_rotation=rotation,
        equilibrium_translation=translation,
        targets=_target_motion(modules, springs, n, period),
        own=own_torques(own, efforts[known : known + own]),
        compensation=no_compensation(n) if compensation is None else compensation,
        efforts=efforts,
        desired=np.zeros(n),
    )


def _target_motion(modules: TaskModules, springs: list[Spring], n: int, period: float) -> TargetMotion:
    """Marks the dampers that count from their equilibrium."""
    joints = [False] * n
    for arm in modules.arms:
        if arm.bias is not None and arm.bias.damping_against == EQUILIBRIUM:
            for joint in arm.bias.joints:
                joints[joint] = True
    return target_motion([spring.spec.damping_against == EQUILIBRIUM for spring in springs], joints, period)


def module_names(
    modules: TaskModules, own: Sequence[OwnModule] = (), *, compensated: bool = False
) -> tuple[str, ...]:
    """Names the rows of ``Modules.efforts``, in their order."""
    springs = [spring.name for arm in modules.arms for spring in arm.springs]
    biases = [f"{arm.limb.name}.joint_bias" for arm in modules.arms]
    return (
        *springs,
        *biases,
        "squeeze",
        "weight",
        *(spring.module for spring in modules.between),
        *(obstacle.module for obstacle in modules.obstacles),
        *(f"{OWN}{m.name}" for m in own),
        *([COMPENSATION] if compensated else []),
    )


def write_gains(into: Modules, modules: TaskModules, damping: Damping) -> None:
    """Puts a phase's gains in force at once."""
    springs = [spring for arm in modules.arms for spring in arm.springs]
    for s, spring in enumerate(springs):
        into.springs.stiffness[s] = spring.world_stiffness
        into.springs.damping[s] = damping.of_spring(spring)
        into.springs.force[s] = spring.axis_force()
    into.bias.damping[:] = joint_damping_matrix(modules, damping, into.desired.size)
    for s, between in enumerate(modules.between):
        into.between.damping[s] = damping.of_between(between)


def joint_damping_matrix(modules: TaskModules, damping: Damping, n: int) -> Array:
    """Gathers the dampers of all arms' joint springs, (n, n) [N.m.s/rad]."""
    found = np.zeros((n, n))
    for arm in modules.arms:
        if arm.bias is not None:
            found[np.ix_(arm.bias.joints, arm.bias.joints)] = damping.of_joints(arm.limb.name)
    return found


def write_target_motion(
    into: Modules, modules: TaskModules, motion: PhaseMotion | None, clock: float
) -> None:
    """Writes how fast equilibria and rest angles move at a phase's clock [s], for dampers that count from them.

    Without a motion they are at rest.
    """
    if not into.targets.active:
        return
    if motion is None:
        into.springs.target_twist[:], into.bias.rest_velocity[:] = 0.0, 0.0
        return
    twists, rates = motion.velocities(clock), motion.rest_rates(clock)
    for s, name in enumerate(spring.name for arm in modules.arms for spring in arm.springs):
        if into.targets.springs[s]:
            into.springs.target_twist[s] = twists[name]
    for arm in modules.arms:
        if arm.bias is not None and arm.bias.damping_against == EQUILIBRIUM:
            into.bias.rest_velocity[arm.bias.joints] = rates[arm.limb.name]


def write_equilibrium(into: Modules, modules: TaskModules, targets: Equilibrium) -> None:
    """Puts equilibria in force at once."""
    springs = [spring.name for arm in modules.arms for spring in arm.springs]
    for s, name in enumerate([*springs, *(spring.name for spring in modules.between)]):
        into.equilibrium_rotation[s] = targets.springs[name].rotation
        into.equilibrium_translation[s] = targets.springs[name].translation
    for arm in modules.arms:
        if arm.bias is not None:
            into.bias.rest[arm.bias.joints] = targets.rests[arm.limb.name]
