# SPDX-License-Identifier: BSD-3-Clause
"""Everything that a task puts into MuJoCo, compiled: robot, hands, surfaces, object, and how soft each contact is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.contact_law import (
    CONTACT_IMPEDANCE,
    FRICTION_RATE,
    FRICTION_RATIO,
    softness,
)
from impedance_modules.backends.mujoco.held_body import (
    GraspStart,
    add_grasps,
    add_object,
    add_object_contacts,
    grasp_start,
    stiffen_welds,
)
from impedance_modules.backends.mujoco.robot_bodies import (
    OWN,
    RobotIndices,
    add_actuators,
    add_robot,
    compile_model,
    robot_indices,
)
from impedance_modules.backends.mujoco.surroundings import (
    HandMount,
    TouchingPair,
    add_hand_contacts,
    add_hands,
    add_surfaces,
)
from impedance_modules.backends.mujoco.users_model import read_users_model
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.errors import BadInput
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.plant.step_stability import SHORTEST_STEP
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import UPRIGHT_GRAVITY
from impedance_modules.spec.task import SurfaceSpec

LONGEST_STEP = 0.5e-3
"""Integration step unless a contact needs a shorter one [s]."""

LARGEST_SWING = 0.3
"""Of a contact's or coupling's vibration within one step [rad]: a fifth of where the integrator becomes unstable."""


@dataclass(frozen=True)
class MujocoScene:
    """A compiled model.

    Attributes:
        compiled: MuJoCo's.
        indices: Where the robot is in its vectors.
        mounts: Of all hands, in the order of the robot's limbs.
        grasp: How the object is held at the start; None without an object.
        step: Integration step that its contacts bear [s].
    """

    compiled: mujoco.MjModel
    indices: RobotIndices
    mounts: tuple[HandMount, ...]
    grasp: GraspStart | None
    step: float


def build_scene(
    model: RobotModel,
    surfaces: tuple[SurfaceSpec, ...],
    held: ObjectBody | None,
    posture: Array,
    plant: PlantEffects,
    mjcf: Path | None = None,
) -> MujocoScene:
    """Builds a scene around the robot of a folder, or around a model of one's own of the same robot.

    Args:
        model: The robot.
        surfaces: As they really are; none that ``surroundings.refuse_surfaces`` refuses.
        held: What the hands hold, or None.
        posture: (n,) at the start [rad].
        plant: Of the robot's patch: play in its joints, and how its base leans.
        mjcf: The model of one's own; None for none.

    Raises:
        BadInput: MuJoCo refuses the robot, would need too short a step, or ``mjcf`` is another robot.
    """
    gravity = plant.gravity_turn @ np.array(UPRIGHT_GRAVITY)
    if mjcf is not None:
        spec, mounts = read_users_model(mjcf, model, posture, gravity, plant.gap)
        return furnish(spec, model, surfaces, held, posture, mounts)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_robot(spec, model, gravity, plant.gap)
    mounts = tuple(_mount(model, limb.hand) for limb in model.limbs.values())
    return furnish(spec, model, surfaces, held, posture, mounts)


def _mount(model: RobotModel, hand: str) -> HandMount:
    frame = model.pin_model.frames[model.frame_id(hand)]
    placement = frame.placement
    joint = model.joint_names[frame.parentJoint - 1]
    return HandMount(hand, f"{OWN}{joint}", np.array(placement.rotation), np.array(placement.translation))


def furnish(
    spec: mujoco.MjSpec,
    model: RobotModel,
    surfaces: tuple[SurfaceSpec, ...],
    held: ObjectBody | None,
    posture: Array,
    mounts: tuple[HandMount, ...],
) -> MujocoScene:
    """Adds drives, hands, surfaces and object to a model that holds the robot, and compiles it."""
    _set_options(spec)
    add_actuators(spec, model)
    add_hands(spec, mounts)
    add_surfaces(spec, surfaces)
    pairs = add_hand_contacts(spec, mounts, surfaces)
    start = None
    if held is not None:
        poses = [model.pose(posture, mount.frame) for mount in mounts]
        start = grasp_start(
            held, tuple(mount.frame for mount in mounts), poses, np.array(spec.option.gravity)
        )
        add_object(spec, held, start)
        pairs += add_object_contacts(spec, surfaces) + add_grasps(spec, start, mounts)
    compiled = compile_model(spec, f"robot '{model.spec.name}'")
    swing = _soften(compiled, pairs)
    if held is not None:
        stiffen_welds(compiled, held, mounts)
    return MujocoScene(compiled, robot_indices(compiled, model.joint_names), mounts, start, _step_for(swing))


def _set_options(spec: mujoco.MjSpec) -> None:
    """Sets how MuJoCo integrates and solves, whatever a file says."""
    option = spec.option
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = FRICTION_RATIO
    # Set to a state of its own by MuJoCo, a robot that flew apart would look whole again.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _soften(compiled: mujoco.MjModel, pairs: list[TouchingPair]) -> float:
    """Writes each contact's softness; returns the fastest vibration on one of them [rad/s]."""
    fastest = 0.0
    for pair in pairs:
        index = compiled.pair(pair.name).id
        shapes = (compiled.pair_geom1[index], compiled.pair_geom2[index])
        bodies = compiled.geom_bodyid[list(shapes)]
        lightness = float(compiled.body_invweight0[bodies, 0].sum())
        soft = softness(pair.stiffness, pair.damping, lightness, CONTACT_IMPEDANCE)
        compiled.pair_solref[index], compiled.pair_solimp[index] = soft.solref, soft.solimp
        compiled.pair_solreffriction[index] = (0.0, -FRICTION_RATE * CONTACT_IMPEDANCE)
        spring = math.sqrt(pair.points * pair.stiffness * lightness)
        fastest = max(fastest, spring, pair.points * pair.damping * lightness)
    return fastest


def _step_for(fastest: float) -> float:
    """Gives the integration step for the fastest vibration [rad/s].

    Raises:
        BadInput: It is too short.
    """
    parts = max(1, math.ceil(LONGEST_STEP * fastest / LARGEST_SWING - 1e-9))
    if LONGEST_STEP / parts < SHORTEST_STEP:
        raise BadInput(
            f"MuJoCo would need an integration step of {LONGEST_STEP / parts:.2g} s for a contact that vibrates at"
            f" {fastest:.4g} rad/s (valid: at least {SHORTEST_STEP:.2g} s; a heavier object, a softer surface)"
        )
    return LONGEST_STEP / parts
