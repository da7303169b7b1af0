# SPDX-License-Identifier: BSD-3-Clause
"""What really happens in the plant, for recordings, tests and comparisons; never for a controller."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from impedance_modules.errors import BadInput, nearest
from impedance_modules.plant.energy_balance import EnergyBook, potential_energies, works
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import ELASTIC, measurable_torques, motor_positions
from impedance_modules.plant.plant_state import PlantState
from impedance_modules.plant.wood import WoodState, wood_states
from impedance_modules.records import Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose

OBJECT = "object"
"""Name of the held object among the bodies."""


class GroundTruth:
    """Read access to the plant's true state. Every array given is a copy.

    Attributes:
        state: The state itself, for tests and benchmarks.
        frames: Of the hands.
    """

    def __init__(
        self, model: RobotModel, state: PlantState, integrator: Integrator, frames: tuple[str, ...]
    ) -> None:
        self._model = model
        self.state = state
        self._integrator = integrator
        self.frames = frames
        self._weightless = pin.Model(integrator.links)
        self._weightless.armature = np.zeros(model.n)
        self._truth_data = self._weightless.createData()

    @property
    def time(self) -> float:
        """Since ``reset`` [s]."""
        return self._integrator.time

    @property
    def position(self) -> Vector:
        """Link positions q (n,) [rad]."""
        return self.state.start.position.copy()

    @property
    def velocity(self) -> Vector:
        """Link velocities (n,) [rad/s]."""
        return self.state.start.velocity.copy()

    @property
    def motor_position(self) -> Vector:
        """Motor positions theta (n,) seen at the joints [rad]."""
        theta = np.empty(self.state.n)
        motor_positions(self.state, theta)
        return theta

    @property
    def encoder_position(self) -> Vector:
        """True positions (n,) where each joint's encoder sits [rad]: q, or theta."""
        return np.where(self._model.encoder_at_motor, self.motor_position, self.state.start.position)

    @property
    def motor_velocity(self) -> Vector:
        """Motor velocities (n,) [rad/s]."""
        return self.state.start.motor_velocity.copy()

    @property
    def load(self) -> Vector:
        """Torque between gear and link (n,) [N.m], before the sensor."""
        return np.array(self.state.joints["load"])

    @property
    def sensed_torque(self) -> Vector:
        """What a perfect effort sensor reports (n,) [N.m]: the spring's deflection torque K_sea (theta - q).

        The spring's structural damping passes torque too, but bends nothing that a sensor could see. A
        joint without a spring has its sensor in the load path.
        """
        torque = np.empty(self.state.n)
        measurable_torques(self.state, torque)
        return torque

    @property
    def motor_work(self) -> float:
        """Work of the commanded torque at the motors since ``reset`` [J], along the plant's own states."""
        return float(self.state.start.work["command_work"][0])

    @property
    def object_pose(self) -> Pose | None:
        """Pose of the object's centre of mass in world, along its own axes; None without an object.

        The centre is the object's origin, unless a patch moves it.
        """
        if not self.state.body.present:
            return None
        rotation = self.state.body.rotation.copy()
        return Pose(rotation, self.state.start.object_position.copy())

    @property
    def object_twist(self) -> Vector | None:
        """Twist (6,) of the object at its centre of mass, world axes; None without an object."""
        body = self.state.body
        if not body.present:
            return None
        rotation = body.rotation
        local = rotation.T @ self.state.start.object_momentum / body.inertia
        return np.concatenate([self.state.start.object_velocity, rotation @ local])

    @property
    def hinge_angle(self) -> float | None:
        """Angle of the object's hinge [rad]; None without a hinge."""
        return self.state.hinge.angle if self.state.hinge.present else None

    @property
    def hinge_torque(self) -> float | None:
        """Torque of friction, springs and stops on the object about its hinge's axis [N.m]; None without a hinge."""
        return self.state.hinge.torque if self.state.hinge.present else None

    @property
    def hinge_wrench(self) -> Vector:
        """Wrench (6,) of the hinge on the object, world axes at its origin [N], [N.m]; zero without a hinge."""
        return self.state.hinge.wrench.copy()

    def pose(self, frame: str) -> Pose:
        """Computes the true pose of any frame of the robot in world."""
        return self._model.pose(self.state.start.position, frame)

    def hand_twist(self, frame: str) -> Vector:
        """Gives the true twist (6,) of a hand frame at its origin, world axes [m/s], [rad/s]."""
        self._integrator.place()
        jacobian = self.state.jacobian[self._body(frame)]
        return np.asarray(jacobian @ self.state.start.velocity)

    def contact_wrench(self, body: str) -> Vector:
        """Gives the wrench (6,) of all surfaces on a hand frame or ``object``, world axes at its origin."""
        return np.array(self.state.contact_wrench[self._body(body)])

    @property
    def woods(self) -> tuple[WoodState, ...]:
        """What has become of every piece of wood, in the order of the task's surfaces."""
        return wood_states(self.state)

    def caught(self, body: str) -> bool:
        """Whether a splinter holds a hand frame or ``object``."""
        own = self.state.contacts["body"] == self._body(body)
        return bool(np.any(own & (self.state.contacts["splinter"] >= 0)))

    def grasp_wrench(self, body: str) -> Vector:
        """Gives the wrench (6,) of the grasp on a hand frame, or of all hands on ``object``."""
        return np.array(self.state.grasp_wrench[self._body(body)])

    def push_wrench(self, body: str) -> Vector:
        """Gives the wrench (6,) with which a hand frame or ``object`` is pushed, world axes at its origin."""
        return np.array(self.state.push_wrench[self._body(body)])

    def _body(self, name: str) -> int:
        bodies = (*self.frames, OBJECT) if self.state.body.present else self.frames
        if name not in bodies:
            raise BadInput(
                f"the plant has no body '{name}'{nearest(name, bodies)} (valid: {', '.join(bodies)})"
            )
        return bodies.index(name)

    def place(self, velocity: Vector, spring_deflection: Vector) -> None:
        """Sets the joints moving, rotors with their links, springs deflected by theta - q (n,) [rad].

        For experiments on the plant itself; positions and the object stay where they are.
        """
        elastic, start = self.state.joints["kind"] == ELASTIC, self.state.start
        start.velocity[:] = velocity
        start.motor_velocity[:] = velocity
        start.motor_position[:] = start.position + elastic * spring_deflection

    def energy_book(self, gravity: tuple[float, float, float]) -> EnergyBook:
        """Adds up every energy and work since ``reset`` [J] under a gravity [m/s^2]."""
        self._integrator.refresh()
        plant, body = self.state, self.state.body
        q, v = plant.start.position, plant.start.velocity
        rotor = plant.joints["reflected_inertia"] * plant.start.motor_velocity**2
        height = pin.computePotentialEnergy(self._weightless, self._truth_data, q)
        kinetic = pin.computeKineticEnergy(self._weightless, self._truth_data, q, v)
        taken_along = sum(
            0.5 * float(self._truth_data.v[int(i)].vector @ water @ self._truth_data.v[int(i)].vector)
            for i, water in enumerate(plant.links["added_mass"])
            if plant.links[i]["submerged"]
        )
        moving, twist = 0.0, self.object_twist
        if twist is not None:
            spin = body.rotation.T @ twist[3:]
            moving = 0.5 * float(body.mass * twist[:3] @ twist[:3] + body.inertia @ spin**2)
            height -= float(body.mass) * float(np.dot(gravity, plant.start.object_position))
        return EnergyBook(
            links=float(kinetic) + taken_along,
            rotors=0.5 * float(np.sum(rotor)),
            body=moving,
            gravity=float(height),
            **potential_energies(plant),
            **works(plant),
        )
