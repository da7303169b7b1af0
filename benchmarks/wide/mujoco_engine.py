# SPDX-License-Identifier: BSD-3-Clause
"""First engine: MuJoCo, with its implicit or its Runge-Kutta integrator, its springs and its constraint friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Link, write_mjcf
from benchmarks.wide.plan import STEP, Plan

Array = NDArray[np.float64]

INTEGRATORS = {"mujoco_implicit": "implicitfast", "mujoco_runge_kutta": "RK4"}


class Rigid:
    """Rigid links of a model: torques of a motion, and of standing still."""

    def __init__(self, links: tuple[Link, ...], hand: str, gravity: Array) -> None:
        """Takes links, parents first, and gravity (3,) in the world [m/s^2]."""
        self.model = mujoco.MjModel.from_xml_string(write_mjcf(with_world(links), None, gravity, hand))
        self._data = mujoco.MjData(self.model)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Returns the joints' torques (n,) of one state [N.m]."""
        data, out = self._data, np.zeros(q.size)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_comVel(self.model, data)
        mujoco.mj_rne(self.model, data, 1, out)
        return out

    def inertia(self, q: Array) -> Array:
        """Returns the mass matrix (n, n)."""
        still = np.zeros(q.size)
        base = self.torque(q, still, still)
        return np.stack([self.torque(q, still, unit) - base for unit in np.eye(q.size)], axis=1)


class MujocoEngine:
    """An arm with its drives; `torque_on` is the coupling torque that joint sensors read."""

    def __init__(self, plan: Plan) -> None:
        """Builds the model of a plan's true arm."""
        self.model = mujoco.MjModel.from_xml_string(_xml(plan))
        self._data = mujoco.MjData(self.model)
        self.believed = Rigid(plan.believed, plan.hand, np.array([0.0, 0.0, -9.81]))
        self._plan, self._n, self._rigid = plan, plan.reference.shape[1], plan.rigid
        self._hand = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, plan.hand)
        self._own_friction = plan.friction_law == "constraint"
        self.sensed = np.zeros(self._n)

    def start(self, q: Array, v: Array) -> None:
        """Puts the arm at a position and speed with its springs loaded by the weight."""
        plan, n, data = self._plan, self._n, self._data
        rest = Rigid(plan.links, plan.hand, plan.gravity).torque(q, np.zeros(n), np.zeros(n))
        data.qpos[:n], data.qvel[:n] = q, v
        if not self._rigid:
            data.qpos[n:] = q + rest / plan.joints.stiffness + 0.5 * np.sign(rest) * plan.joints.gap
            data.qvel[n:] = v
        mujoco.mj_forward(self.model, data)
        self.sensed[:] = rest

    @property
    def q(self) -> Array:
        """(n,) of the links [rad]."""
        return self._data.qpos[: self._n]

    @property
    def v(self) -> Array:
        """(n,) of the links [rad/s]."""
        return self._data.qvel[: self._n]

    @property
    def theta(self) -> Array:
        """(n,) of the motors [rad]."""
        return self._data.qpos[: self._n] if self._rigid else self._data.qpos[self._n :]

    @property
    def w(self) -> Array:
        """(n,) of the motors [rad/s]."""
        return self._data.qvel[: self._n] if self._rigid else self._data.qvel[self._n :]

    def step(self, link: Array, motor: Array, levels: Array, force: Array) -> None:
        """Goes on by one step of the physics under torques on links and motors, and a force on the hand."""
        data, n, plan = self._data, self._n, self._plan
        data.xfrc_applied[self._hand, :3] = force
        if self._rigid:
            data.qfrc_applied[:] = link + motor
        else:
            data.qfrc_applied[:n], data.qfrc_applied[n:] = link, motor
        if self._own_friction:
            self.model.dof_frictionloss[:] = levels.sum(axis=0) if self._rigid else levels.reshape(-1)
        before = data.qvel[:n].copy()
        mujoco.mj_step(self.model, data)
        if self._rigid:
            speed = data.qvel[:n]
            rotor = plan.joints.rotor_inertia * (speed - before) / STEP
            rotor += plan.joints.motor_damping * 0.5 * (speed + before)
            self.sensed[:] = motor - rotor
            if self._own_friction:
                share = levels[1] / np.maximum(levels.sum(axis=0), 1e-12)
                self.sensed += share * data.qfrc_constraint[:n]
        else:
            length = data.qpos[n:] - data.qpos[:n]
            slack = np.maximum(np.abs(length) - 0.5 * plan.joints.gap, 0.0)
            self.sensed[:] = plan.joints.stiffness * np.sign(length) * slack

    def energy_of_weight(self) -> float:
        """Returns the potential energy of links and springs [J]."""
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        mujoco.mj_energyPos(self.model, self._data)
        return float(self._data.energy[0])


def with_world(links: tuple[Link, ...]) -> tuple[Link, ...]:
    """Leaves out masses that MuJoCo refuses: of frames, zero."""
    return tuple(
        replace(link, inertial=None) if link.inertial is not None and link.inertial.mass <= 0.0 else link
        for link in links
    )


def _xml(plan: Plan) -> str:
    links, joints = with_world(plan.links), plan.joints
    root = ET.fromstring(write_mjcf(links, None if plan.rigid else joints, plan.gravity, plan.hand))
    option = root.find("option")
    if option is None:
        raise ValueError("the model has no <option>")
    option.set("integrator", INTEGRATORS[plan.engine])
    option.set("iterations", "50")
    if plan.rigid:
        by_name = {one.attrib["name"]: one for one in root.iter("joint")}
        for i, link in enumerate([link for link in links if link.joint is not None]):
            by_name[str(link.joint)].set("armature", repr(float(joints.rotor_inertia[i])))
            by_name[str(link.joint)].set("damping", repr(float(joints.motor_damping[i])))
    if plan.friction_law == "constraint":
        for one in root.iter("joint"):
            if "type" in one.attrib:
                one.set("frictionloss", "1e-9")
    return ET.tostring(root, encoding="unicode")
