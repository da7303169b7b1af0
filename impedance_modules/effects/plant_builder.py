# SPDX-License-Identifier: BSD-3-Clause
"""Collects what a patch's effects do to a plant; several effects on one joint add up or follow one another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.law_torque import LawTorque
from impedance_modules.effects.motion import WornTorque
from impedance_modules.effects.rigid_model import sliding_joints
from impedance_modules.effects.worn import SensorErrors, WornPlant
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3

if TYPE_CHECKING:
    from impedance_modules.effects.effect import JointLaw

Array = NDArray[np.float64]


class PlantBuilder:
    """The plant's numbers before they are frozen; effects write into them.

    Attributes:
        model: The robot as plant and model wear it.
        torques: Torques on joints.
        gap, drive_delay, drive_limit, drive_gain, drive_lag: (n,) see ``WornPlant`` and ``DrivePath``.
        spring_stiffness, spring_preload, coupling: Likewise.
        offset, effort_gain, effort_bias, crosstalk, velocity_lag, clock: See ``SensorErrors``.
        added_mass: (n, 6, 6) see ``WornPlant``.
        tilt: (2,) rotation of the base about x and y [rad].
        modelled_delay: Part of the model's command delay that the drives make, joint by joint [s].
    """

    def __init__(self, model: RobotModel) -> None:
        n = model.n
        self.model = model
        self.torques: list[WornTorque] = []
        self.gap, self.drive_delay, self.drive_lag = np.zeros(n), np.zeros(n), np.zeros(n)
        self.drive_limit, self.drive_gain = np.full(n, np.inf), np.ones(n)
        self.spring_stiffness, self.spring_preload = np.zeros(n), np.zeros(n)
        self.coupling, self.crosstalk = np.zeros((n, n)), np.zeros((n, n))
        self.offset, self.effort_bias, self.velocity_lag = np.zeros(n), np.zeros(n), np.zeros(n)
        self.effort_gain = np.ones(n)
        self.added_mass = np.zeros((n, 6, 6))
        self.clock = 1.0
        self.tilt = np.zeros(2)
        self.modelled_delay = 0.0

    def joint(self, name: str) -> int:
        """Finds a joint's index."""
        return self.model.joint_names.index(name)

    def joints(self, names: Mapping[str, object]) -> NDArray[np.intp]:
        """Finds the indices of a mapping's joints, in its order."""
        return np.array([self.joint(name) for name in names], dtype=np.intp)

    def add_law(self, law: JointLaw, port: Port, parameters: Mapping[str, Mapping[str, float]]) -> None:
        """Puts a law of motion on joints, as a torque against them."""
        pieces = [law.linear(values) for values in parameters.values()]
        shape = {name: np.array([shape[name] for _, shape in pieces]) for name in law.shape}
        coefficients = np.array([coefficient for coefficient, _ in pieces])
        side: Literal["motor", "link"] = "motor" if port == "actuator" else "link"
        lightness = self.motor_mobility if side == "motor" else self.link_mobility
        joints = self.joints(parameters)
        sliding = sliding_joints(self.model.pin_model)[joints]
        self.torques.append(
            LawTorque(
                law.basis,
                side,
                joints,
                coefficients=coefficients,
                shape=shape,
                mobility=lightness,
                sliding=sliding,
            )
        )

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
        links.armature = np.where(rigid, self.model.reflected_inertia, 0.0)
        return np.array(np.diag(pin.computeMinverse(links, links.createData(), position)))

    def motor_mobility(self, position: Array) -> Array:
        """Computes the motors' acceleration per torque (n,) [1/(kg.m^2)]; rigid and ideal ones move links."""
        alone = [j.spring_stiffness is not None and j.reflected_inertia > 0.0 for j in self.model.joints]
        rotors = np.where(alone, self.model.reflected_inertia, 1.0)
        return np.where(alone, 1.0 / rotors, self.link_mobility(position))

    def finish(self) -> WornPlant:
        """Freezes the numbers."""
        drive = DrivePath(self.drive_delay, self.drive_limit, self.drive_gain, self.drive_lag)
        sensors = SensorErrors(
            self.offset, self.effort_gain, self.effort_bias, self.crosstalk, self.velocity_lag, self.clock
        )
        return WornPlant(
            torques=(*((drive,) if drive.does_anything else ()), *self.torques),
            gap=self.gap,
            coupling=self.coupling,
            added_mass=self.added_mass,
            drive_gain=self.drive_gain,
            spring_stiffness=self.spring_stiffness,
            spring_preload=self.spring_preload,
            sensors=sensors,
            command_delay=max(0.0, self.model.spec.timing.command_delay - self.modelled_delay),
            gravity_turn=exp3(np.array([*self.tilt, 0.0])).T,
        )
