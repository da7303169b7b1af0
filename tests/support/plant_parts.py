# SPDX-License-Identifier: BSD-3-Clause
"""Robots, postures and surfaces for the plant's tests: undamped robots without limits, palms on a box."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec, SensorSpec
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec
from tests.support.paths import CHECKOUT

BAXTER = CHECKOUT / "robots" / "baxter"
SIX_JOINTS = CHECKOUT / "tests" / "robots" / "six_joint_pair"
WEIGHTLESS = (0.0, 0.0, 0.0)
PERFECT = SensorSpec(0.0, 0.0, 0.0, 0.0, 0.0)

ARM = {"s0": 0.0, "s1": -0.4, "e0": 0.0, "e1": 1.2, "w0": 0.0, "w1": 0.7, "w2": 0.0}
PALMS_OUT = {"left": {**ARM, "s0": -0.6}, "right": {**ARM, "s0": 0.6}}


@cache
def spec_of(folder: Path) -> RobotSpec:
    return read_robot(folder)


def with_every(spec: RobotSpec, **numbers: object) -> RobotSpec:
    """The robot with some numbers replaced at every joint."""
    return replace(spec, joints={name: replace(joint, **numbers) for name, joint in spec.joints.items()})


def undamped(spec: RobotSpec) -> RobotSpec:
    """No damping, no stops in reach, nobody compensates gravity, no delay: what is left must conserve."""
    free = with_every(spec, motor_damping=0.0, spring_damping=0.0, position_min=-1e3, position_max=1e3)
    timing = replace(spec.timing, command_delay=0.0)
    return replace(free, gravity_compensation="none", timing=timing, sensors=PERFECT)


def exact(spec: RobotSpec) -> RobotSpec:
    """Perfect sensors and no delay."""
    return replace(spec, sensors=PERFECT, timing=replace(spec.timing, command_delay=0.0))


def plant(
    spec: RobotSpec,
    surfaces: Sequence[SurfaceSpec] = (),
    held: ObjectBody | None = None,
    **options: object,
) -> Plant:
    return Plant(RobotModel(spec), surfaces, held, PlantOptions(**{"rate": 1000.0, "seed": 0, **options}))


def posture(model: RobotModel, angles: Mapping[str, Mapping[str, float]] = PALMS_OUT) -> np.ndarray:
    return model.position(angles)


def middle(model: RobotModel) -> np.ndarray:
    """The posture in the middle of all limits."""
    return 0.5 * (model.column("position_min") + model.column("position_max"))


def started(
    spec: RobotSpec,
    surfaces: Sequence[SurfaceSpec] = (),
    held: ObjectBody | None = None,
    at: Callable[[RobotModel], np.ndarray] = posture,
    **options: object,
) -> Plant:
    """A plant at rest in a posture."""
    subject = plant(spec, surfaces, held, **options)
    subject.reset(at(subject.model))
    return subject


def idle(subject: Plant, periods: int) -> list[np.ndarray]:
    """Lets time pass under the torque that carries the start; contact wrenches on an object, once per period."""
    wrenches = []
    for _ in range(periods):
        subject.advance(subject.start_command)
        wrenches += [] if subject.object_pose is None else [subject.contact_wrench("object")]
    return wrenches


def place_object(subject: Plant, pose: Pose, twist: np.ndarray) -> None:
    """Moves the object to a pose with a twist (6,) at its origin, world axes."""
    body, start = subject.state.body, subject.state.start
    body.rotation[:] = pose.rotation
    start.object_position[:] = pose.translation
    start.object_velocity[:] = twist[:3]
    start.object_momentum[:] = pose.rotation @ (body.inertia * (pose.rotation.T @ twist[3:]))


def plane(height: float, **numbers: object) -> SurfaceSpec:
    values = {"stiffness": 20000.0, "damping": 50.0, "friction": 0.3, "rotation": (0.0, 0.0, 0.0), **numbers}
    return SurfaceSpec(surface="plane", height=height, position=None, size=None, **values)


def block(
    position: tuple[float, float, float], size: tuple[float, float, float], **numbers: object
) -> SurfaceSpec:
    values = {"stiffness": 20000.0, "damping": 50.0, "friction": 0.3, "rotation": (0.0, 0.0, 0.0), **numbers}
    return SurfaceSpec(surface="box", height=None, position=position, size=size, **values)


def box(**numbers: object) -> ObjectSpec:
    values = {"mass": 1.2, "size": (0.3, 0.2, 0.2), "position": None, "grasp": "weld", "friction": None}
    values |= {"squeeze": 0.0, "carry_weight": True, "held_by": (), "shape": "box"}
    return ObjectSpec(**{**values, **numbers})


def loose(**numbers: object) -> ObjectBody:
    """An object that nobody holds."""
    return ObjectBody(box(**{"position": (2.0, 0.0, 1.0), **numbers}), ())


def in_both_hands(spec: RobotSpec, **numbers: object) -> ObjectBody:
    return ObjectBody(box(**numbers), tuple(limb.hand for limb in spec.limbs.values()))
