# SPDX-License-Identifier: BSD-3-Clause
"""What a patch's effects do to a plant: frozen numbers, torques on joints, and the builder that collects them.

Several effects on one joint add up or follow one another.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.compiled import Law
from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.joint_law_torque import Basis, LawOnJoints, LawTorque, PythonLawTorque, Side
from impedance_modules.effects.joint_motion import EffectTorque, Shape
from impedance_modules.effects.rigid_model import sliding_joints
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3


@dataclass(frozen=True)
class SensorErrors:
    r"""What the robot reports beside the truth, for all n joints.

        q_reported = q + offset        effort_reported = gain (effort + crosstalk effort) + bias
        v_reported = low pass of v with ``lag``         t_reported = clock t

    Attributes:
        offset: (n,) [rad].
        gain: (n,) of the effort sensors.
        bias: (n,) [N.m].
        crosstalk: (n, n) share of column j's effort in row i's reading.
        lag: (n,) time constant beyond the robot file's [s].
        clock: Reported seconds per second.
    """

    offset: Array
    gain: Array
    bias: Array
    crosstalk: Array
    lag: Array
    clock: float


@dataclass(frozen=True)
class PlantEffects:
    """What reality does and the controller's model does not know.

    Attributes:
        torques: On motors and links, in the order in which they are asked.
        gap: (n,) full backlash between motor and link [rad].
        coupling: (n, n) rotor inertia that couples two motors [kg.m^2]; symmetric, zero diagonal.
        added_mass: (n, 6, 6) inertia without weight of what each joint's link takes along, linear then angular,
            in the joint's own axes; symmetric, positive semidefinite.
        drive_gain: (n,) motor torque per torque asked for; needed to start in equilibrium.
        drive_crosstalk: (n, n) share of the torque asked of column j that row i's motor gives; zero diagonal.
        spring_stiffness, spring_preload: (n,) parallel springs that a robot which carries its own weight
            compensates too [N.m/rad], [N.m].
        sensors: Errors of its sensors.
        command_delay: Delay [s] of the command line itself, without what ``torques`` adds.
        gravity_turn: (3, 3) turns gravity's direction into the tilted base's axes.
    """

    torques: tuple[EffectTorque, ...]
    gap: Array
    coupling: Array
    added_mass: Array
    drive_gain: Array
    drive_crosstalk: Array
    spring_stiffness: Array
    spring_preload: Array
    sensors: SensorErrors
    command_delay: float
    gravity_turn: Array


class PlantBuilder:
    """The plant's numbers before they are frozen; effects write into them.

    Attributes:
        model: The robot with the effects that plant and model share.
        torques: Torques on joints.
        gap, drive_delay, drive_limit, drive_gain, drive_lag: (n,) see ``PlantEffects`` and ``DrivePath``.
        drive_crosstalk: (n, n) likewise.
        spring_stiffness, spring_preload, coupling: Likewise.
        offset, effort_gain, effort_bias, crosstalk, velocity_lag, clock: See ``SensorErrors``.
        added_mass: (n, 6, 6) see ``PlantEffects``.
        tilt: (2,) rotation of the base about x and y [rad].
        modelled_delay: Part of the model's command delay that the drives make, joint by joint [s].
    """

    def __init__(self, model: RobotModel) -> None:
        n = model.n
        self.model = model
        self.torques: list[EffectTorque] = []
        self.gap, self.drive_delay, self.drive_lag = np.zeros(n), np.zeros(n), np.zeros(n)
        self.drive_limit, self.drive_gain = np.full(n, np.inf), np.ones(n)
        self.spring_stiffness, self.spring_preload = np.zeros(n), np.zeros(n)
        self.coupling, self.crosstalk = np.zeros((n, n)), np.zeros((n, n))
        self.drive_crosstalk = np.zeros((n, n))
        self.offset, self.effort_bias, self.velocity_lag = np.zeros(n), np.zeros(n), np.zeros(n)
        self.effort_gain = np.ones(n)
        self.added_mass = np.zeros((n, 6, 6))
        self.clock = 1.0
        self.tilt = np.zeros(2)
        self.modelled_delay = 0.0

    def joint(self, name: str) -> int:
        """Finds a joint's index."""
        return self.model.joint_names.index(name)

    def joints(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Finds the indices (k,) of joints by their names."""
        return np.array([self.joint(name) for name in names], dtype=np.int64)

    def add_law(
        self,
        basis: Basis,
        port: Port,
        names: Sequence[str],
        *,
        coefficients: Array,
        shape: Shape,
        text: Law[..., None] | None = None,
    ) -> None:
        """Puts a law of motion on joints, as a torque against them.

        Args:
            basis: What the consumed torque is linear in, (k, p).
            port: ``actuator`` for the motors' side of the gear, else the links'.
            names: Of the k joints.
            coefficients: (k, p).
            shape: Nonlinear parameters, (k,) each, in the order in which ``text`` reads them.
            text: The basis as a compiled law (``JointLaw.law``); None where Python has to evaluate it.
        """
        side: Side = "motor" if port == "actuator" else "link"
        joints = self.joints(names)
        mobility = self.motor_mobility if side == "motor" else self.link_mobility
        sliding = sliding_joints(self.model.pin_model)[joints]
        on = LawOnJoints(basis, side, joints, coefficients, shape, mobility, sliding)
        self.torques.append(PythonLawTorque(on) if text is None else LawTorque(text, on))

    def take_along(self, link: str, along: Array, centre: Array) -> None:
        """Lets a link take water along.

        Args:
            link: Its name.
            along: (6,) mass along [kg] and inertia about [kg.m^2] the link's axes.
            centre: (3,) in the link's frame [m], where ``along`` is meant.
        """
        frame = self.model.pin_model.frames[self.model.frame_id(link)]
        onto_centre = (frame.placement * pin.SE3(np.eye(3), centre)).inverse().action
        self.added_mass[frame.parentJoint - 1] += onto_centre.T @ (along[:, None] * onto_centre)

    def link_mobility(self, position: Array) -> Array:
        """Computes the links' acceleration per torque on each (n,) [1/(kg.m^2)]; rigid joints carry rotors."""
        links = pin.Model(self.model.pin_model)
        rigid = [joint.spring_stiffness is None for joint in self.model.joints]
        links.armature = np.where(rigid, self.model.rotor_inertia, 0.0)
        return np.array(np.diag(pin.computeMinverse(links, links.createData(), position)))

    def motor_mobility(self, position: Array) -> Array:
        """Computes the motors' acceleration per torque (n,) [1/(kg.m^2)]; rigid and ideal ones move links."""
        alone = [j.spring_stiffness is not None and j.reflected_inertia > 0.0 for j in self.model.joints]
        rotors = np.where(alone, self.model.rotor_inertia, 1.0)
        return np.where(alone, 1.0 / rotors, self.link_mobility(position))

    def finish(self) -> PlantEffects:
        """Freezes the numbers."""
        drive = DrivePath(
            self.drive_delay, self.drive_limit, self.drive_gain, self.drive_crosstalk, self.drive_lag
        )
        sensors = SensorErrors(
            self.offset, self.effort_gain, self.effort_bias, self.crosstalk, self.velocity_lag, self.clock
        )
        return PlantEffects(
            torques=(*((drive,) if drive.does_anything else ()), *self.torques),
            gap=self.gap,
            coupling=self.coupling,
            added_mass=self.added_mass,
            drive_gain=self.drive_gain,
            drive_crosstalk=self.drive_crosstalk,
            spring_stiffness=self.spring_stiffness,
            spring_preload=self.spring_preload,
            sensors=sensors,
            command_delay=max(0.0, self.model.spec.timing.command_delay - self.modelled_delay),
            gravity_turn=exp3(np.array([*self.tilt, 0.0])).T,
        )
