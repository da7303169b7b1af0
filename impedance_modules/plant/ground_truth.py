# SPDX-License-Identifier: BSD-3-Clause
"""What really happens in the plant, for recordings, tests and comparisons; never for a controller."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.errors import BadInput, nearest
from impedance_modules.plant.equations_of_motion import spring_loads
from impedance_modules.plant.wood import WoodState, wood_states
from impedance_modules.plant.energy_balance import EnergyBook, potential_energies, works
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import motor_position
from impedance_modules.plant.plant_state import COMMAND, ELASTIC, PUSH_ROW, Memory
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose

Array = NDArray[np.float64]

OBJECT = "object"
"""Name of the held object among the bodies."""


class Truth:
    """Read access to the plant's true state. Every array given is a copy."""

    def __init__(
        self, model: RobotModel, memory: Memory, integrator: Integrator, frames: tuple[str, ...]
    ) -> None:
        self._model = model
        self._memory = memory
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
    def position(self) -> Array:
        """Link positions q (n,) [rad]."""
        return self._memory.part("position").copy()

    @property
    def velocity(self) -> Array:
        """Link velocities (n,) [rad/s]."""
        return self._memory.part("velocity").copy()

    @property
    def motor_position(self) -> Array:
        """Motor positions theta (n,) seen at the joints [rad]."""
        part = self._memory.part
        return motor_position(self._memory.joints, part("position"), part("motor_position"))

    @property
    def motor_velocity(self) -> Array:
        """Motor velocities (n,) [rad/s]."""
        return self._memory.part("motor_velocity").copy()

    @property
    def load(self) -> Array:
        """Torque between gear and link (n,) [N.m], before the sensor."""
        return np.array(self._memory.joints["load"])

    @property
    def sensed_torque(self) -> Array:
        """What a perfect effort sensor reports (n,) [N.m]: the spring's deflection torque K_sea (theta - q).

        The spring's structural damping passes torque too, but bends nothing that a sensor could see. A
        joint without a spring has its sensor in the load path.
        """
        torque = np.empty(self._memory.n)
        spring_loads(self._memory.joints, self._memory.state, torque)
        return torque

    @property
    def command_acting(self) -> Array:
        """Torque command (n,) that acted in the last period [N.m]; zero in the robot's own modes."""
        return np.array(self._memory.joints["command"])

    @property
    def motor_work(self) -> float:
        """Work of the commanded torque at the motors since ``reset`` [J], along the plant's own states."""
        return float(self._memory.part("work")[COMMAND])

    @property
    def object_pose(self) -> Pose | None:
        """Pose of the object in world; None without an object."""
        if not self._memory.body[0]["present"]:
            return None
        rotation = np.array(self._memory.body[0]["rotation"])
        return Pose(rotation, self._memory.part("object_position").copy())

    @property
    def object_twist(self) -> Array | None:
        """Twist (6,) of the object at its origin, world axes; None without an object."""
        body = self._memory.body[0]
        if not body["present"]:
            return None
        rotation = np.array(body["rotation"])
        local = rotation.T @ self._memory.part("object_momentum") / body["inertia"]
        return np.concatenate([self._memory.part("object_velocity"), rotation @ local])

    def pose(self, frame: str) -> Pose:
        """Computes the true pose of any frame of the robot in world."""
        return self._model.pose(self._memory.part("position"), frame)

    def hand_twist(self, frame: str) -> Array:
        """Gives the true twist (6,) of a hand frame at its origin, world axes [m/s], [rad/s]."""
        self._integrator.place()
        jacobian = self._memory.jacobian[self._body(frame)]
        return np.asarray(jacobian @ self._memory.part("velocity"))

    def contact_wrench(self, body: str) -> Array:
        """Gives the wrench (6,) of all surfaces on a hand frame or ``object``, world axes at its origin."""
        return np.array(self._memory.wrench[self._body(body), 0])

    @property
    def woods(self) -> tuple[WoodState, ...]:
        """What has become of every piece of wood, in the order of the task's surfaces."""
        return wood_states(self._memory)

    def caught(self, body: str) -> bool:
        """Whether a splinter holds a hand frame or ``object``."""
        own = self._memory.contacts["body"] == self._body(body)
        return bool(np.any(own & (self._memory.contacts["caught"] >= 0)))

    def grasp_wrench(self, body: str) -> Array:
        """Gives the wrench (6,) of the grasp on a hand frame, or of all hands on ``object``."""
        return np.array(self._memory.wrench[self._body(body), 1])

    def push_wrench(self, body: str) -> Array:
        """Gives the wrench (6,) with which somebody pushes a hand frame or ``object``, world axes at its origin."""
        return np.array(self._memory.wrench[self._body(body), PUSH_ROW])

    def _body(self, name: str) -> int:
        bodies = (*self.frames, OBJECT) if self._memory.body[0]["present"] else self.frames
        if name not in bodies:
            raise BadInput(
                f"the plant has no body '{name}'{nearest(name, bodies)} (valid: {', '.join(bodies)})"
            )
        return bodies.index(name)

    def place(self, velocity: Array, spring_deflection: Array) -> None:
        """Sets the joints moving, rotors with their links, springs wound by theta - q (n,) [rad].

        For experiments on the plant itself; positions and the object stay where they are.
        """
        elastic = self._memory.joints["kind"] == ELASTIC
        part = self._memory.part
        part("velocity")[:] = velocity
        part("motor_velocity")[:] = velocity
        part("motor_position")[:] = part("position") + elastic * spring_deflection

    def place_object(self, pose: Pose, twist: Array) -> None:
        """Moves the object to a pose with a twist (6,) at its origin, world axes."""
        body = self._memory.body[0]
        if not body["present"]:
            raise BadInput("the plant has no object to place")
        body["rotation"] = pose.rotation
        self._memory.part("object_position")[:] = pose.translation
        self._memory.part("object_velocity")[:] = twist[:3]
        spin = pose.rotation.T @ twist[3:]
        self._memory.part("object_momentum")[:] = pose.rotation @ (np.array(body["inertia"]) * spin)

    def energy_book(self, gravity: tuple[float, float, float]) -> EnergyBook:
        """Adds up every energy and work since ``reset`` [J] under a gravity [m/s^2]."""
        self._integrator.refresh()
        memory, body = self._memory, self._memory.body[0]
        q, v = memory.part("position"), memory.part("velocity")
        rotor = memory.joints["reflected_inertia"] * memory.part("motor_velocity") ** 2
        height = pin.computePotentialEnergy(self._weightless, self._truth_data, q)
        kinetic = pin.computeKineticEnergy(self._weightless, self._truth_data, q, v)
        taken_along = sum(
            0.5 * float(self._truth_data.v[int(i)].vector @ water @ self._truth_data.v[int(i)].vector)
            for i, water in enumerate(memory.links["water"])
            if memory.links[i]["wet"]
        )
        moving, twist = 0.0, self.object_twist
        if twist is not None:
            spin = np.array(body["rotation"]).T @ twist[3:]
            moving = 0.5 * float(body["mass"] * twist[:3] @ twist[:3] + body["inertia"] @ spin**2)
            height -= float(body["mass"]) * float(np.dot(gravity, memory.part("object_position")))
        return EnergyBook(
            links=float(kinetic) + taken_along,
            rotors=0.5 * float(np.sum(rotor)),
            body=moving,
            gravity=float(height),
            **potential_energies(memory),
            **works(memory),
        )
