# SPDX-License-Identifier: BSD-3-Clause
r"""The nominal model that the recordings are compared with: rigid links, drives, and what the robot adds itself.

link port      \tau_s = M(q) a + C(q, v) v + g(q)                              (thesis eq. 3.1)
actuator port  \tau_m = \tau_s + I_r \ddot\theta + D \dot\theta,  \theta = q + \tau_s / K   (thesis eq. 3.2-3.3)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_tree import RigidTree, read_tree
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.patch_check import numbers
from impedance_modules.errors import BadInput
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.robot_spec import EncoderSide, InnerTorqueLoopSpec, RobotSpec


@dataclass(frozen=True, eq=False)
class NominalModel:
    """What is assumed about the robot before any recording is used.

    Attributes:
        robot: Its name.
        tree: Rigid bodies of the recorded joints, n of them.
        reflected_inertia: (n,) I_r [kg.m^2]; 0 where nothing is stated.
        motor_damping: (n,) D [N.m.s/rad].
        compliance: (n,) 1 / K_sea [rad/(N.m)]; 0 for a rigid joint.
        command_delay: From a command to the torque acting [s].
        velocity_filter: Time constant of the reported velocity [s].
        position_resolution, effort_resolution: Grids of the sensors; 0 where nothing is stated.
        effort_max: (n,) [N.m]; infinite where nothing is stated.
        spring_damping: (n,) beside the joint's spring [N.m.s/rad].
        inner_loop: The robot's own feedback of joint torque; None where nothing is stated.
        hands: Limb -> the frame of its hand; empty where nothing is stated.
        notes: What was assumed when it was made of a description, in sentences.
        encoders: (n,) side of the gear on which each joint's position is measured; None, or none at all, where nobody
            says.
    """

    robot: str
    tree: RigidTree
    reflected_inertia: Array
    motor_damping: Array
    compliance: Array
    command_delay: float
    velocity_filter: float
    position_resolution: float
    effort_resolution: float
    effort_max: Array
    spring_damping: Array
    inner_loop: InnerTorqueLoopSpec | None = None
    hands: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    encoders: tuple[EncoderSide | None, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, in the order of every array."""
        return self.tree.joints

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)


def model_of_urdf(urdf: Path, joints: Sequence[str]) -> NominalModel:
    """Builds the model of a bare URDF: rigid links, ideal drives, no delay.

    Raises:
        BadInput: The URDF cannot be read or lacks a joint.
    """
    if not urdf.is_file():
        raise BadInput(f"--urdf {urdf}: no such file (valid: a URDF of the recorded robot)")
    tree = read_tree(urdf, joints)
    zero = np.zeros(len(tree.joints))
    limits = [body.limits for body in tree.bodies]
    effort = [limit.effort if limit is not None and limit.effort > 0.0 else np.inf for limit in limits]
    return NominalModel(urdf.stem, tree, zero, zero, zero, 0.0, 0.0, 0.0, 0.0, np.array(effort), zero)


def model_of_spec(spec: RobotSpec, joints: Sequence[str]) -> NominalModel:
    """Builds the model of a robot file that was read already, with its patches applied.

    Raises:
        BadInput: It lacks a joint.
    """
    tree = read_tree(spec.urdf, joints)
    missing = [joint for joint in tree.joints if joint not in spec.joints]
    if missing:
        raise BadInput(
            f"robot '{spec.name}': joint '{missing[0]}' belongs to no limb (valid: {', '.join(spec.joints)})"
        )
    drives = [spec.joints[joint] for joint in tree.joints]
    stiffness = (drive.spring_stiffness for drive in drives)
    return NominalModel(
        robot=spec.name,
        tree=tree,
        reflected_inertia=np.array([drive.reflected_inertia for drive in drives]),
        motor_damping=np.array([drive.motor_damping for drive in drives]),
        compliance=np.array([0.0 if k is None else 1.0 / k for k in stiffness]),
        command_delay=spec.timing.command_delay,
        velocity_filter=spec.sensors.velocity_filter,
        position_resolution=spec.sensors.position_resolution,
        effort_resolution=spec.sensors.effort_resolution,
        effort_max=np.array([drive.effort_max for drive in drives]),
        spring_damping=np.array([drive.spring_damping for drive in drives]),
        inner_loop=spec.inner_torque_loop,
        hands={limb.name: limb.hand for limb in spec.limbs.values()},
        encoders=tuple(drive.encoder for drive in drives),
    )


def with_encoders(
    model: NominalModel, side: EncoderSide, joints: Collection[str] | None = None
) -> NominalModel:
    """States on which side the encoders of some joints sit, or those of all joints of which nothing is stated."""
    stated = model.encoders or (None,) * model.n
    chosen = [
        side if (known is None if joints is None else joint in joints) else known
        for joint, known in zip(model.joints, stated, strict=True)
    ]
    return replace(model, encoders=tuple(chosen))


def with_known_effects(
    model: NominalModel, known_effects: Sequence[EffectSpec]
) -> tuple[NominalModel, tuple[EffectSpec, ...]]:
    """Applies the known effects of a patch to the nominal model, as far as they replace its numbers.

    A rotor inertia in a patch is the model's from then on: recordings then show what is beyond it, and causes report
    the sum, not the robot file's number plus the whole.

    Args:
        model: As the robot file has it.
        known_effects: Effects of the patch, on recorded joints and links.

    Returns:
        The model, and the effects that add to it.
    """
    adding = []
    for spec in known_effects:
        replaced = {
            key: CATALOGUE[spec.effect].joint_numbers(numbers(symbols))
            for key, symbols in spec.parameters.items()
        }
        side = CATALOGUE[spec.effect].encoder_side(cast("Port", spec.port))
        if side is not None:
            model = with_encoders(model, side, spec.parameters)
        if any(replaced.values()):
            model = _with(model, replaced)
        else:
            adding.append(spec)
    return model, tuple(adding)


def _with(model: NominalModel, replaced: Mapping[str, Mapping[str, float]]) -> NominalModel:
    """Replaces joints' numbers in a model."""
    changed: dict[str, Any] = {}
    for joint, own in replaced.items():
        for name, value in own.items():
            changed.setdefault(name, getattr(model, name).copy())[model.joints.index(joint)] = value
    return replace(model, **changed)
