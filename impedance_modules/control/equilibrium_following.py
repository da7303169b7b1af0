# SPDX-License-Identifier: BSD-3-Clause
r"""How equilibria, stiffness and forces follow set-points that arrive while a task runs.

Set-points come when they come, late, doubled or not at all. The equilibrium X never jumps to one: it goes after the
goal X_g with the lag T of the task and at most its speed v_max. With e = [p_g - p; log(R_g R^T)] in world axes, for
the linear and the angular part alike,

    v^* = e / T, shortened to v_max;     |v - v_last| <= v_max h / T;     p <- p + h v,   R <- exp(h \omega) R

Without a set-point that is fresh v^* = 0: the equilibrium comes to rest within T. On a goal at rest it never goes too
far, for braking in v = e / T takes v / T <= v_max / T. A stated stiffness K and the forces F of hybrid axes are the
most there is; with parts s, f in [0, 1] per axis of the spring, which change by at most h / T_b in a cycle,

    K' = S K S,   S = diag(sqrt(s)),        F' = diag(f) F

and K' is symmetric and positive semidefinite because K is. Dampers stay as the phase has designed them for K.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.equilibrium import Equilibrium, EquilibriumMotion, PhaseMotion
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.modules.spring import Spring, displacement
from impedance_modules.modules.sum import Modules
from impedance_modules.records import Array3, Flag, Indices, Matrix, Record, Scalar
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import compose, exponential, write_rotation
from impedance_modules.spec.set_point_limits import SetPointLimits, TargetLimits

WHOLE_CHANGE = 0.5
"""T_b: time in which a stiffness or a force may go from nothing to what the task states [s]."""


class Following(Record):
    """The targets that follow set-points in one phase.

    Attributes:
        active: Whether the phase listens at all.
        period: h [s].
        lag: T [s].
        goal: (targets, 7) newest position [m] and unit quaternion (x, y, z, w), in world.
        stiffness, force: (targets, 6) newest diagonal of K' [N/m, N.m/rad] and F' [N, N.m], in the spring's axes.
        fresh: (targets,) 1 where that counts, 0 where it is too old or has not come yet.
        rotation, translation: (targets, 3, 3), (targets, 3) X of the equilibria now [m].
        velocity: (targets, 6) of the equilibria, linear and angular, in world axes [m/s, rad/s].
        speed: (targets, 2) v_max, linear [m/s] and angular [rad/s].
        motion: (targets,) place of each among the poses that the phase moves.
        spring: (targets,) place of its spring, or -1 for the object, whose stiffness belongs to the hands.
        axes: (targets, 3, 3) A, from the spring's axes to the world's.
        stated_stiffness: (targets, 6, 6) K in the spring's axes [N/m, N, N.m/rad].
        stated_force: (targets, 6) F in the spring's axes [N, N.m].
        stiffness_part, force_part: (targets, 6) s and f now.
        stiffness_change, force_change: (targets, 6) what a whole cycle would add to them.
        stepping: A step is prepared and not yet taken.
        granted: Part in [0, 1] of the last cycle's changes that the tank could pay.
    """

    active: Flag
    period: Scalar
    lag: Scalar
    goal: Matrix
    stiffness: Matrix
    force: Matrix
    fresh: Indices
    rotation: Array3
    translation: Matrix
    velocity: Matrix
    speed: Matrix
    motion: Indices
    spring: Indices
    axes: Array3
    stated_stiffness: Array3
    stated_force: Matrix
    stiffness_part: Matrix
    force_part: Matrix
    stiffness_change: Matrix
    force_change: Matrix
    stepping: Flag = False
    granted: Scalar = 1.0


@compiled
def prepare_step(following: Following, blended: bool) -> None:
    """Decides what a whole cycle would change: velocities of the equilibria, parts of stiffness and force.

    Args:
        following: Goals and ``fresh`` are up to date.
        blended: The phase's own gains are in force; before that set-points change none.
    """
    goal, error = np.empty((3, 3)), np.empty(6)
    following.stepping = True
    for k in range(following.fresh.size):
        if following.fresh[k] > 0:
            write_rotation(following.goal[k, 3:], goal)
            displacement(goal, following.goal[k, :3], following.rotation[k], following.translation[k], error)
        else:
            error[:] = 0.0
        for half in range(2):
            _steer(following, error, k, half)
        _prepare_parts(following, k, blended)


@compiled
def _steer(following: Following, error: Array, k: int, half: int) -> None:
    """Brings the linear (half 0) or angular (half 1) velocity of target k towards e / T."""
    most, first = following.speed[k, half], 3 * half
    wanted, length = np.empty(3), 0.0
    for i in range(3):
        wanted[i] = error[first + i] / following.lag
        length += wanted[i] * wanted[i]
    shorten(wanted, math.sqrt(length), most)
    length = 0.0
    for i in range(3):
        wanted[i] -= following.velocity[k, first + i]
        length += wanted[i] * wanted[i]
    shorten(wanted, math.sqrt(length), most * following.period / following.lag)
    for i in range(3):
        following.velocity[k, first + i] += wanted[i]


@compiled
def shorten(vector: Array, length: float, most: float) -> None:
    """Scales a vector of some length down to at most ``most``; a shorter one stays as it is."""
    if length > most:
        for i in range(vector.size):
            vector[i] *= most / length


@compiled
def _prepare_parts(following: Following, k: int, blended: bool) -> None:
    """How much the parts of stiffness and force of target k would change in a cycle."""
    most = following.period / WHOLE_CHANGE
    for i in range(6):
        following.stiffness_change[k, i] = 0.0
        following.force_change[k, i] = 0.0
        if not blended or following.spring[k] < 0 or following.fresh[k] == 0:
            continue
        stated = following.stated_stiffness[k, i, i]
        if stated > 0.0:
            away = following.stiffness[k, i] / stated - following.stiffness_part[k, i]
            following.stiffness_change[k, i] = min(max(away, -most), most)
        stated = following.stated_force[k, i]
        if stated != 0.0:
            away = following.force[k, i] / stated - following.force_part[k, i]
            following.force_change[k, i] = min(max(away, -most), most)


@compiled
def place_step(following: Following, motion: EquilibriumMotion, modules: Modules, part: float) -> None:
    """Puts the targets where a part in [0, 1] of the prepared step takes them.

    Args:
        following: After ``prepare_step``; not changed.
        motion: Of the phase: the poses of the targets are overwritten, in which its springs ride.
        modules: Stiffness and force of the targets' springs are overwritten where they change.
        part: Of the cycle's step.
    """
    turn, vector = np.empty((3, 3)), np.empty(3)
    for k in range(following.fresh.size):
        m, reach = following.motion[k], part * following.period
        for i in range(3):
            vector[i] = reach * following.velocity[k, 3 + i]
            motion.motions.reference_translation[m, i] = (
                following.translation[k, i] + reach * following.velocity[k, i]
            )
        exponential(vector, turn)
        compose(turn, following.rotation[k], motion.motions.reference_rotation[m])
        if following.spring[k] >= 0:
            _place_gains(following, modules, k, part)


@compiled
def _place_gains(following: Following, modules: Modules, k: int, part: float) -> None:
    """Writes K' and F' of target k in world axes, where a step changes them."""
    changes = False
    root, force = np.empty(6), np.empty(6)
    for i in range(6):
        changes = changes or following.stiffness_change[k, i] != 0.0 or following.force_change[k, i] != 0.0
        root[i] = math.sqrt(
            max(0.0, following.stiffness_part[k, i] + part * following.stiffness_change[k, i])
        )
        share = following.force_part[k, i] + part * following.force_change[k, i]
        force[i] = share * following.stated_force[k, i]
    if not changes:
        return
    A, K, s = following.axes[k], following.stated_stiffness[k], following.spring[k]
    for a in range(6):
        modules.springs.force[s, a] = 0.0
        for i in range(3):
            modules.springs.force[s, a] += A[a % 3, i] * force[3 * (a // 3) + i]
        for b in range(6):
            modules.springs.stiffness[s, a, b] = 0.0
            for i in range(3):
                for j in range(3):
                    c, d = 3 * (a // 3) + i, 3 * (b // 3) + j
                    modules.springs.stiffness[s, a, b] += (
                        A[a % 3, i] * root[c] * K[c, d] * root[d] * A[b % 3, j]
                    )


@compiled
def take_step(following: Following, motion: EquilibriumMotion, part: float) -> None:
    """Makes the part of the step that has been granted final; what was not granted costs speed.

    Args:
        following: Overwritten.
        motion: After ``place_step`` with the same part.
        part: Granted, in [0, 1].
    """
    following.stepping, following.granted = False, part
    for k in range(following.fresh.size):
        m = following.motion[k]
        following.translation[k] = motion.motions.reference_translation[m]
        following.rotation[k] = motion.motions.reference_rotation[m]
        for i in range(6):
            following.velocity[k, i] *= part
            following.stiffness_part[k, i] += part * following.stiffness_change[k, i]
            following.force_part[k, i] += part * following.force_change[k, i]


def following_nothing() -> Following:
    """The state of a phase that does not listen."""
    return _make(0, 1.0, 1.0, active=False)


def follow_set_points(
    limits: SetPointLimits,
    modules: TaskModules,
    motion: PhaseMotion,
    laid_out: EquilibriumMotion,
    period: float,
) -> Following:
    """Prepares the targets of a phase that listens: each stays where it is until a set-point comes.

    Args:
        limits: Of the task.
        modules: With the gains of the phase.
        motion: Of the phase, in which every target rests.
        laid_out: The same as arrays.
        period: Of the control [s].
    """
    springs = {spring.name: spring for arm in modules.arms for spring in arm.springs}
    following = _make(len(limits.targets), period, limits.lag, active=True)
    for k, (target, given) in enumerate(limits.targets.items()):
        _begin_target(following, k, given)
        start = motion.moved[target].reference
        following.rotation[k], following.translation[k] = start.rotation, start.translation
        if target == OBJECT:
            following.motion[k], following.spring[k] = 0, -1
        else:
            place = list(springs).index(target)
            following.motion[k], following.spring[k] = laid_out.rides[place], place
            _begin_gains(following, k, springs[target])
    return following


def followed_equilibrium(start: Equilibrium, following: Following, modules: Modules) -> Equilibrium:
    """Where the equilibria are when a phase that listened ends: those that followed have come to somewhere.

    Args:
        start: Where the phase's own motion has taken the others.
        following: Of the phase.
        modules: In force.
    """
    held = start.object
    for k in np.flatnonzero(following.spring < 0):
        held = Pose(following.rotation[k].copy(), following.translation[k].copy())
    in_force = {
        name: Pose(modules.equilibrium_rotation[s].copy(), modules.equilibrium_translation[s].copy())
        for s, name in enumerate(start.springs)
    }
    return Equilibrium(in_force, held, start.rests)


def _begin_target(following: Following, k: int, limits: TargetLimits) -> None:
    following.speed[k] = limits.speed, limits.turn_speed
    following.goal[k] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0


def _begin_gains(following: Following, k: int, spring: Spring) -> None:
    following.axes[k] = spring.axes
    following.stated_stiffness[k] = spring.stiffness
    following.stated_force[k] = spring.force
    following.stiffness[k] = np.diag(spring.stiffness)
    following.force[k] = spring.force


def _make(count: int, period: float, lag: float, *, active: bool) -> Following:
    """Takes the memory; parts are whole."""
    return Following(
        active=active,
        period=period,
        lag=lag,
        goal=np.zeros((count, 7)),
        stiffness=np.zeros((count, 6)),
        force=np.zeros((count, 6)),
        fresh=np.zeros(count, dtype=np.int64),
        rotation=np.zeros((count, 3, 3)),
        translation=np.zeros((count, 3)),
        velocity=np.zeros((count, 6)),
        speed=np.zeros((count, 2)),
        motion=np.zeros(count, dtype=np.int64),
        spring=np.full(count, -1, dtype=np.int64),
        axes=np.zeros((count, 3, 3)),
        stated_stiffness=np.zeros((count, 6, 6)),
        stated_force=np.zeros((count, 6)),
        stiffness_part=np.ones((count, 6)),
        force_part=np.ones((count, 6)),
        stiffness_change=np.zeros((count, 6)),
        force_change=np.zeros((count, 6)),
    )
