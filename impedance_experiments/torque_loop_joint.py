# SPDX-License-Identifier: BSD-3-Clause
r"""One elastic joint with its own torque loop on the plant: does a passive load make it oscillate, and how heavy is it?

The load that a drive of admittance Y excites most at a frequency w has the impedance -1 / Y(w): a spring or a mass,
as -1 / Y is imaginary where the drive is just passive (``robot/inner_torque_loop.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.joint_motion import JointMotion
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.records import Vector
from impedance_modules.robot.inner_torque_loop import LoopTiming, PassiveGain, admittance, loop_delay
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import BodyChange, InnerTorqueLoopSpec, JointSpec, RobotSpec
from impedance_modules.spec.task_reader import read_task

TASK = "one-joint"
"""Its robot is a wheel on one joint."""
RATE = 1000.0
"""Of the control cycle, which is that of the inner loop [Hz]."""
START = 1e-4
"""Angle by which the wheel is turned and let go [rad]."""
WATCHED = 8.0
"""For how long [s]."""
PUSH, PUSHED = 0.1, 2.0
"""Torque on the wheel [N.m], and for how long [s]."""


@dataclass(frozen=True)
class PassiveLoad:
    """A wheel and a spring to the ground [kg.m^2], [N.m/rad]."""

    inertia: float
    stiffness: float


@dataclass(frozen=True)
class Swing:
    """A wheel that was turned and let go.

    Attributes:
        gain: Of the inner loop.
        time: (N,) [s].
        angle: (N,) of the wheel [rad].
    """

    gain: float
    time: Array
    angle: Array

    @property
    def grown(self) -> float:
        """Root mean square of the angle in the last eighth over that in the second; faster modes are gone by then."""
        eighths = np.array_split(self.angle, 8)
        return float(np.sqrt(np.mean(eighths[-1] ** 2) / np.mean(eighths[1] ** 2)))


class GroundSpring:
    """Torque of a spring between a wheel and the ground, and a push on it."""

    port: Literal["motor", "link"] = "link"

    def __init__(self, stiffness: float, push: float) -> None:
        """Takes the stiffness [N.m/rad] and a constant torque [N.m]."""
        self._stiffness, self._push = stiffness, push

    def torque(self, motion: JointMotion) -> Vector:
        """Gives push - stiffness q (1,) [N.m]."""
        return np.asarray(self._push - self._stiffness * motion.position)

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""


def worst_load(joint: JointSpec, limit: PassiveGain, timing: LoopTiming, wheel: float) -> PassiveLoad:
    """Finds the passive load that oscillates with a drive at its highest passive gain for ever.

    Args:
        joint: The drive.
        limit: Its highest passive gain and the frequency where it stops being passive.
        timing: Of its loop.
        wheel: Inertia that is there in any case [kg.m^2]; a spring holds it where the load is no mass.
    """
    at = limit.frequency
    reactance = float((-1.0 / admittance(joint, limit.gain, timing, np.array([at]))[0]).imag)
    inertia = max(wheel, reactance / at)
    return PassiveLoad(inertia, at * (at * inertia - reactance))


def loop_timing(loop: InnerTorqueLoopSpec) -> LoopTiming:
    """Gives the timing of a loop that the plant samples at ``RATE``."""
    return LoopTiming(1.0 / RATE, loop_delay(loop, 1.0 / RATE) / RATE)


def wheel_inertia() -> float:
    """Gives the inertia of the bare wheel [kg.m^2]."""
    model = RobotModel(_wheel())
    return float(model.mass_matrix(np.zeros(1))[0, 0] - model.reflected_inertia[0])


def swung(joint: JointSpec, loop: InnerTorqueLoopSpec, load: PassiveLoad) -> Swing:
    """Turns the wheel a little, lets it go and watches it."""
    plant = _plant(joint, loop, load, 0.0)
    plant.state.start.position[:] = START
    time, angle, _ = _watched(plant, WATCHED)
    return Swing(loop.gain, time, angle)


def measured_inertia(joint: JointSpec, loop: InnerTorqueLoopSpec | None) -> float:
    r"""Pushes the wheel with a constant torque and fits \tau t = I v + D q + p; returns I less the wheel's [kg.m^2].

    p is the momentum of the swing between wheel and rotor, zero on average but for its beginning.
    """
    wheel = wheel_inertia()
    plant = _plant(joint, loop, PassiveLoad(wheel, 0.0), PUSH)
    time, angle, speed = _watched(plant, PUSHED)
    columns = np.column_stack([speed, angle, np.ones_like(time)])
    fitted, *_ = np.linalg.lstsq(columns, PUSH * time, rcond=None)
    return float(fitted[0]) - wheel


def _watched(plant: Plant, duration: float) -> tuple[Array, Array, Array]:
    rows = []
    for _ in range(round(duration * RATE)):
        plant.advance(np.zeros(1))
        rows.append((plant.time, plant.position[0], plant.velocity[0]))
    time, angle, speed = np.array(rows).T
    return time, angle, speed


def _plant(joint: JointSpec, loop: InnerTorqueLoopSpec | None, load: PassiveLoad, push: float) -> Plant:
    plant = Plant(RobotModel(_robot(joint, loop, load)), (), None, PlantOptions(RATE, 0, noise=False))
    plant.torques.append(GroundSpring(load.stiffness, push))
    plant.reset(np.zeros(1))
    return plant


def _wheel() -> RobotSpec:
    _, robot = read_task(TASK)
    return robot


def _robot(joint: JointSpec, loop: InnerTorqueLoopSpec | None, load: PassiveLoad) -> RobotSpec:
    """Gives the wheel another drive, a heavier body and a torque loop."""
    robot = _wheel()
    (limb,), (name,) = robot.limbs.values(), robot.joints
    more = load.inertia - wheel_inertia()
    drive = replace(
        robot.joints[name],
        spring_stiffness=joint.spring_stiffness,
        spring_damping=joint.spring_damping,
        reflected_inertia=joint.reflected_inertia,
        motor_damping=joint.motor_damping,
        effort_max=joint.effort_max,
    )
    heavier = (0.0, 0.0, 0.0, 0.0, 0.5 * more, 0.0, 0.5 * more, 0.0, 0.0, more)
    changes = (BodyChange(limb.hand, heavier),) if more > 0.0 else ()
    return replace(robot, joints={name: drive}, body_changes=changes, inner_torque_loop=loop)
