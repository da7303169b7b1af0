# SPDX-License-Identifier: BSD-3-Clause
r"""The dampers of a whole task, fixed at the start of a phase: explicit ones, and those from the inertia.

Which springs are damped together (design 4, "Damping"): all springs of one frame share that frame's
modes; the springs of all hands on a held object share the object's modes, with the object's summed
stiffness and inertia; joint springs share the limb's joint-space modes; springs between the same two frames
share the modes of their relative motion, on the inertia of both arms.

Damping from inertia and stiffness goes mode by mode: c = 2 \zeta \sqrt{k m}, in many dimensions. A mass M on springs K
has modes K \Phi = M \Phi \Omega^2 with \Phi^T M \Phi = I. The damping that gives every mode its ratio is
D = M \Phi diag(2 \zeta \omega) \Phi^T M, always positive semidefinite.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.modules.arms import ArmModule, TaskModules
from impedance_modules.modules.between_spring import BetweenSpring, relative_jacobian, springs_at
from impedance_modules.modules.mobility import RANK_TOLERANCE, carry_mobility, mobility, parallel_sum
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import carry
from impedance_modules.spec.between_spec import FrameOfArm


@dataclass(frozen=True)
class Damping:
    """All dampers of a phase; ``*_modal`` follow from a damping ratio, ``*_explicit`` are declared.

    Attributes:
        spring_modal, spring_explicit: Spring name -> (6, 6), world axes at the spring's frame.
        joint_modal, joint_explicit: Limb name -> (k, k) over the limb's joints, for limbs with a bias.
        between_modal: Spring between two arms -> (6, 6) in the spring's own axes.
    """

    spring_modal: Mapping[str, Array]
    spring_explicit: Mapping[str, Array]
    joint_modal: Mapping[str, Array]
    joint_explicit: Mapping[str, Array]
    between_modal: Mapping[str, Array] = field(default_factory=dict)

    def of_spring(self, spring: Spring) -> Array:
        """Sums a spring's dampers, (6, 6) [N.s/m, N.m.s/rad]."""
        return self.spring_modal[spring.name] + self.spring_explicit[spring.name]

    def of_joints(self, limb: str) -> Array:
        """Sums a limb's joint dampers, (k, k) [N.m.s/rad]."""
        return self.joint_modal[limb] + self.joint_explicit[limb]

    def of_between(self, spring: BetweenSpring) -> Array:
        """Sums the dampers of a spring between two arms, (6, 6) [N.s/m, N.m.s/rad]."""
        modal, explicit = self.between_modal[spring.name], spring.spec.damping
        return modal if explicit is None else modal + explicit


def phase_damping(modules: TaskModules, kinematics: Kinematics) -> Damping:
    """Designs every damper of a phase at the state for which ``kinematics`` was last updated.

    Args:
        modules: Springs and biases with the gains of the phase.
        kinematics: Of all ``modules.frames``; its inverse inertia includes the reflected inertia.
    """
    springs = [spring for arm in modules.arms for spring in arm.springs]
    modal: dict[str, Array] = {}
    for group in _groups(modules, springs):
        modal.update(_frame_group(group, modules, kinematics))
    if modules.held is not None:
        modal.update(_object_group(modules, kinematics))
    biased = [arm for arm in modules.arms if arm.bias is not None]
    return Damping(
        spring_modal={spring.name: modal[spring.name] for spring in springs},
        spring_explicit={spring.name: spring.in_world(spring.damping) for spring in springs},
        joint_modal={arm.limb.name: _joint_modal(arm, kinematics) for arm in biased},
        joint_explicit={arm.limb.name: np.diag(arm.bias.damping) for arm in biased if arm.bias is not None},
        between_modal=_between_arms(modules, kinematics),
    )


def _between_arms(modules: TaskModules, kinematics: Kinematics) -> dict[str, Array]:
    """Damps springs between the same two frames, in the same axes, with the modes of that relative motion."""
    rests = {spring.name: spring.start for spring in modules.between}
    laid_out = springs_at(modules.between, kinematics, rests)
    groups: dict[tuple[FrameOfArm | None, ...], list[int]] = {}
    for place, spring in enumerate(modules.between):
        key = spring.spec.first, spring.spec.second, spring.spec.expressed_in
        groups.setdefault(key, []).append(place)
    found = {}
    for places in groups.values():
        moves = relative_jacobian(laid_out, kinematics.arms, places[0])
        specs = [modules.between[place].spec for place in places]
        ratios = [spec.damping_ratio or 0.0 for spec in specs]
        dampers = endpoint_damping(
            [spec.stiffness for spec in specs], ratios, mobility(moves, kinematics.inverse_inertia)
        )
        found.update({spec.name: modal for spec, modal in zip(specs, dampers, strict=True)})
    return found


def _groups(modules: TaskModules, springs: Sequence[Spring]) -> list[list[Spring]]:
    """Collects the springs that do not hold the object by frame."""
    holding = modules.held.springs if modules.held is not None else ()
    frames: dict[str, list[Spring]] = {}
    for spring in springs:
        if spring.name not in holding:
            frames.setdefault(spring.frame, []).append(spring)
    return list(frames.values())


def _frame_group(group: Sequence[Spring], modules: TaskModules, kinematics: Kinematics) -> dict[str, Array]:
    """Damps the springs of one frame with that frame's modes."""
    joints = modules.arm(group[0].limb).limb.joints
    found = mobility(kinematics.jacobian_of(group[0].frame)[:, joints], _inverse_inertia(kinematics, joints))
    return _split(group, [spring.in_world(spring.stiffness) for spring in group], found)


def _object_group(modules: TaskModules, kinematics: Kinematics) -> dict[str, Array]:
    """Damps the springs that hold the object with the object's modes, then carries each back."""
    held = modules.held
    if held is None:
        return {}
    hands = tuple(kinematics.pose(hand) for hand in held.hands)
    object_pose = held.pose_from(hands)
    total = np.asarray(np.linalg.inv(held.inertia(object_pose.rotation)), dtype=np.float64)
    for limb, hand, pose in zip(held.limbs, held.hands, hands, strict=True):
        joints = modules.arm(limb).limb.joints
        at_hand = mobility(kinematics.jacobian_of(hand)[:, joints], _inverse_inertia(kinematics, joints))
        total = parallel_sum(total, carry_mobility(at_hand, pose.translation - object_pose.translation))
    group = [spring for arm in modules.arms for spring in arm.springs if spring.name in held.springs]
    if not group:
        return {}
    offsets = [kinematics.pose(spring.frame).translation - object_pose.translation for spring in group]
    maps = [carry(offset) for offset in offsets]
    carried = [X.T @ spring.in_world(spring.stiffness) @ X for X, spring in zip(maps, group, strict=True)]
    at_object = _split(group, carried, total)
    back = {spring.name: carry(-offset) for spring, offset in zip(group, offsets, strict=True)}
    return {name: back[name].T @ matrix @ back[name] for name, matrix in at_object.items()}


def _split(group: Sequence[Spring], stiffnesses: Sequence[Array], found: Array) -> dict[str, Array]:
    ratios = [0.0 if spring.damping_ratio is None else spring.damping_ratio for spring in group]
    dampers = endpoint_damping(stiffnesses, ratios, found)
    return {spring.name: matrix for spring, matrix in zip(group, dampers, strict=True)}


def _joint_modal(arm: ArmModule, kinematics: Kinematics) -> Array:
    bias = arm.bias
    if bias is None or bias.damping_ratio is None:
        return np.zeros((len(arm.limb.joints), len(arm.limb.joints)))
    inertia = np.linalg.inv(_inverse_inertia(kinematics, bias.joints))
    return joint_damping(bias.stiffness, 0.5 * (inertia + inertia.T), bias.damping_ratio)


def _inverse_inertia(kinematics: Kinematics, joints: NDArray[np.intp]) -> Array:
    """Takes the limb's block of (M + I_r)^-1; limbs on a fixed base do not couple."""
    return kinematics.inverse_inertia[np.ix_(joints, joints)]


def joint_damping(stiffness: Array, inertia: Array, ratio: float) -> Array:
    r"""Damps every mode of joint springs on an arm's inertia.

    With the Cholesky factor M = L L^T and L^-1 K_j L^-T = V \Omega^2 V^T, D_j = L V 2 \zeta \Omega V^T L^T.

    Args:
        stiffness: (k,) K_j [N.m/rad], none negative.
        inertia: (k, k) M + I_r of the limb's joints [kg.m^2].
        ratio: \zeta.

    Returns:
        (k, k) D_j [N.m.s/rad].
    """
    factor = np.linalg.cholesky(inertia)
    half = np.linalg.solve(factor, np.diag(np.sqrt(stiffness)))
    squared, vectors = np.linalg.eigh(half @ half.T)
    modes = factor @ vectors
    return np.asarray((modes * (2.0 * ratio * np.sqrt(np.maximum(squared, 0.0)))) @ modes.T)


def endpoint_damping(
    stiffnesses: Sequence[Array], ratios: Sequence[float], mobility: Array
) -> tuple[Array, ...]:
    r"""Damps every mode of several springs at one point of a mechanism, split over the springs.

    The modes are those of the summed stiffness K on the inertia Y^-1. They are found from the mobility
    Y = G G^T, which exists at singular postures too: G^T K G = V \Omega^2 V^T, \phi = G v. As
    K \phi = \omega^2 Y^-1 \phi, the matrix M \Phi diag(2 \zeta \omega) \Phi^T M becomes

        D_i = \sum_m 2 \zeta_i s_im / \omega_m^3  (K \phi_m)(K \phi_m)^T,
        s_im = \phi_m^T K_i \phi_m / \omega_m^2,     \sum_i s_im = 1.

    s_im is spring i's share of mode m, so cutting a spring in two changes nothing. Directions without
    stiffness, or in which the mechanism cannot move, get no damping.

    Args:
        stiffnesses: (6, 6) K_i of each spring, positive semidefinite, world axes, all at one point.
        ratios: \zeta_i of each spring; 0 for none.
        mobility: (6, 6) Y at that point.

    Returns:
        (6, 6) D_i of each spring, at that point; each positive semidefinite.
    """
    total = np.sum(stiffnesses, axis=0)
    squared, modes = _modes(total, mobility)
    frequency = np.sqrt(squared)
    pull = (total @ modes) / frequency**1.5
    split = []
    for stiffness, ratio in zip(stiffnesses, ratios, strict=True):
        share = np.sum(modes * (stiffness @ modes), axis=0) / squared
        split.append((pull * (2.0 * ratio * np.maximum(share, 0.0))) @ pull.T)
    return tuple(split)


def _modes(stiffness: Array, mobility: Array) -> tuple[Array, Array]:
    """Finds (squared frequencies (r,), mode shapes (6, r)) of the modes that have stiffness."""
    values, vectors = np.linalg.eigh(mobility)
    movable = values > RANK_TOLERANCE * values[-1]
    factor = vectors[:, movable] * np.sqrt(values[movable])
    squared, rotation = np.linalg.eigh(factor.T @ stiffness @ factor)
    # Clipping at zero: rounding may leave a free direction with a tiny negative stiffness.
    stiff = squared > RANK_TOLERANCE * max(float(squared[-1]), 0.0)
    return squared[stiff], factor @ rotation[:, stiff]
