# SPDX-License-Identifier: BSD-3-Clause
r"""The simulated robot on MuJoCo: its physics between the robot's own loops, which are those of the built-in plant.

A control period is whole loops of the robot, of at most 1 ms; a loop is whole steps of MuJoCo, taken in one call. Once
per loop the robot measures its joints, computes what carries its arms' weight, and its drives take the torque of the
command that has arrived (``plant/motor_commands.py``, ``plant/sensors.py``): the same delay, time-out, noise and seeds.
Measured torque is that between gear and link: K (theta - q) of a series spring, and of a rigid joint

    effort = drive - D v - C v|v| - F - I_r a          D, C, F of the motor's side
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.robot_bodies import OWN
from impedance_modules.backends.mujoco.scene import MujocoScene
from impedance_modules.backends.mujoco.worn_effects import LINK, WornEffects
from impedance_modules.effects.joint_motion import JointMotion, joint_motion
from impedance_modules.errors import BadInput, NotConnected, PlantNotFinite, nearest
from impedance_modules.plant.joints import IDEAL, hold_gains, joint_kind
from impedance_modules.plant.motor_commands import (
    CommandQueue,
    Mode,
    Order,
    WeightCompensation,
    checked_effort,
)
from impedance_modules.plant.plant import PlantOptions, divide
from impedance_modules.plant.pushes import push_wrench
from impedance_modules.plant.sensors import Sensors
from impedance_modules.records import Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import PushSpec

HUGE = 1e6
"""Beyond this speed or place nothing is a robot any more [rad/s], [rad], [m]."""


class MujocoPlant:
    """MuJoCo behind the robot's own loops; the same life as ``plant.plant.Plant``.

    Attributes:
        model: The robot, as the controller knows it.
        scene: What was compiled.
        data: MuJoCo's state: ground truth, for tests and recordings, never for a controller.
        start_command: (n,) torque [N.m] that carries the start load; it acts before the first command.
        motor_work: Work of the commanded torque at the motors since ``reset`` [J].
    """

    def __init__(
        self,
        model: RobotModel,
        scene: MujocoScene,
        worn: WornEffects,
        options: PlantOptions,
        pushes: Sequence[PushSpec] = (),
    ) -> None:
        """Takes robot, scene, the effects of a patch, how it is stepped, and who pushes."""
        self.model, self.scene, self._worn, self._options = model, scene, worn, options
        self._division = divide(replace(options, step=scene.step))
        self._physics = scene.compiled
        self._physics.opt.timestep = self._division.step
        worn.joints.write(self._physics, scene.indices)
        if worn.drive is not None:
            # Its limits come behind delay and gain, not before.
            self._physics.actuator_ctrllimited[scene.indices.command] = 0
        # Its warnings would go into a file in the working folder; a state that is not finite is refused here.
        mujoco.set_mju_user_warning(lambda _message: None)
        self.data = mujoco.MjData(self._physics)
        # Views of its arrays: they stay where they are, and asking for them takes longer than using them.
        self._q, self._v, self._ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self._at = scene.indices
        self._half_gap = 0.5 * worn.plant.gap
        self._plays = bool(self._half_gap.any())
        self._all_elastic = bool(self._at.elastic.all())
        self._losses = _motor_losses(self._physics, worn, scene)
        self._compliance = model.spring_compliance()
        self._stiffness = np.array([joint.spring_stiffness or 0.0 for joint in model.joints])
        self._encoders_at_motors = bool(model.encoder_at_motor.any())
        self._ideal = np.array([joint_kind(joint) == IDEAL for joint in model.joints])
        self._weight = WeightCompensation(model, worn.plant, options.gravity)
        self._pushes = _pushed_bodies(model, scene, pushes)
        self._command, self._assist = np.zeros(model.n), np.zeros(model.n)
        self._seen = joint_motion(model.n, command=self._command)
        self._sensors = Sensors(model.spec.sensors, worn.plant.sensors, self._division.loop, None)
        self._queue: CommandQueue | None = None
        self._standing: Order | None = None
        self._periods = 0
        self.start_command: Vector = np.zeros(model.n)
        self.motor_work = 0.0
        self._motor_before: Vector = np.zeros(model.n)

    @property
    def time(self) -> float:
        """Since ``reset`` [s]."""
        return self._periods / self._options.rate

    @property
    def position(self) -> Vector:
        """Joint positions q (n,) [rad]."""
        return np.asarray(self._q[self._at.position])

    @property
    def velocity(self) -> Vector:
        """Joint velocities (n,) [rad/s]."""
        return np.asarray(self._v[self._at.velocity])

    @property
    def motor_position(self) -> Vector:
        """Motor positions theta (n,) [rad]; of an ideal torque source q + tau / K."""
        theta = self._q[self._at.motor_position]
        if self._ideal.any():
            theta[self._ideal] += (self._compliance * self.data.qfrc_actuator[self._at.velocity])[self._ideal]
        return np.asarray(theta)

    @property
    def encoder_position(self) -> Vector:
        """Positions (n,) where each joint's encoder sits [rad]: q, or theta."""
        if not self._encoders_at_motors:
            return self.position
        return np.where(self.model.encoder_at_motor, self.motor_position, self.position)

    def warm(self, q: Vector) -> None:
        """Stands reset at q (n,) [rad]; there is nothing to compile."""
        self.reset(q)

    def reset(self, q: Vector) -> None:
        """Puts everything at rest at q (n,) [rad]; the hands hold the object, pressing with the declared squeeze."""
        position = checked_effort(q, self.model.n)
        mujoco.mj_resetData(self._physics, self.data)
        self.data.qpos[self._at.motor_position] = self.data.qpos[self._at.position] = position
        self._hold_gains(np.zeros(self.model.n), np.zeros(self.model.n))
        self._assist[:] = self._weight.torque(position + self._worn.plant.sensors.offset)
        self.start_command = self._start_command()
        self._command[:] = self.start_command
        self._periods, self.motor_work = 0, 0.0
        if self._worn.drive is not None:
            self._worn.drive.start(self._motion(), self._division.loop)
        self._set_drives()
        mujoco.mj_forward(self._physics, self.data)
        self._motor_before = self.motor_position
        self._start_robot()

    def _start_robot(self) -> None:
        """Starts sensors and command queue."""
        source = np.random.default_rng(self._options.seed) if self._options.noise else None
        self._sensors = Sensors(
            self.model.spec.sensors, self._worn.plant.sensors, self._division.loop, source
        )
        self._sensors.reset(self.encoder_position)
        timing = replace(self.model.spec.timing, command_delay=self._worn.plant.command_delay)
        self._queue = CommandQueue(timing, self._options.rate, Order(Mode.TORQUE, self.start_command.copy()))
        self._standing = None

    def _start_command(self) -> Vector:
        """Finds the command that carries weight, springs and grasp at rest, (n,) [N.m]."""
        data, at = self.data, self._at.velocity
        data.qfrc_applied[at] = self._worn.joints.spring[1]
        mujoco.mj_fwdPosition(self._physics, data)
        mujoco.mj_fwdVelocity(self._physics, data)
        load = data.qfrc_bias[at] - data.qfrc_passive[at] - data.qfrc_applied[at]
        if self.scene.grasp is not None:
            for mount, wrench in zip(self.scene.mounts, self.scene.grasp.wrench, strict=True):
                load = load - self._jacobian(mount.frame).T @ wrench
        lead = self._compliance * load + 0.5 * self._worn.plant.gap * np.sign(load)
        data.qpos[self._at.motor_position] += np.where(self._at.elastic, lead, 0.0)
        gain, crosstalk = self._worn.plant.drive_gain, self._worn.plant.drive_crosstalk
        return np.asarray(np.linalg.solve(np.diag(gain) + crosstalk, load) - self._assist)

    def _jacobian(self, frame: str) -> Array:
        """Computes a hand's Jacobian (6, n), world axes at its frame."""
        whole = np.zeros((6, self._physics.nv))
        site = self._site(frame)
        mujoco.mj_jacSite(self._physics, self.data, whole[:3], whole[3:], site)
        return np.asarray(whole[:, self._at.velocity])

    def _site(self, frame: str) -> int:
        return int(self._physics.site(f"{OWN}hand/{frame}").id)

    def sense(self) -> RobotState:
        """Reports what the robot measures now."""
        self._running()
        if not self._all_elastic:
            # At the present state, not at the beginning of the last step; springs need no acceleration.
            mujoco.mj_forward(self._physics, self.data)
        return self._sensors.sample(self.time, self.sensed_torque)

    @property
    def sensed_torque(self) -> Vector:
        """What a perfect effort sensor between gear and link reports (n,) [N.m]; after ``mj_forward``, where rigid."""
        lead = self._q[self._at.motor_position] - self._q[self._at.position]
        if self._plays:
            lead -= np.clip(lead, -self._half_gap, self._half_gap)
        spring = self._stiffness * lead
        return np.asarray(
            spring if self._all_elastic else np.where(self._at.elastic, spring, self._rigid_torque())
        )

    def _rigid_torque(self) -> Vector:
        """Gives what drives leave for the links behind rotors, damping and friction of their own (n,) [N.m]."""
        data, at = self.data, self._at.motor_velocity
        v, (inertia, damping, drag) = self._v[at], self._losses
        lost = inertia * data.qacc[at] + damping * v + drag * v * np.abs(v)
        return np.asarray(data.qfrc_actuator[at] - lost + self._dry_friction())

    def _dry_friction(self) -> Vector:
        """Gives the torque (n,) [N.m] of MuJoCo's friction constraints on the motors' side."""
        data, out = self.data, np.zeros(self._physics.nv)
        if data.nf == 0:
            return out[self._at.velocity]
        rows = slice(data.ne, data.ne + data.nf)
        of_joints = data.efc_type[rows] == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
        out[data.efc_id[rows][of_joints]] = data.efc_force[rows][of_joints]
        level = self._physics.dof_frictionloss[self._at.velocity]
        links = self._worn.joints.friction[LINK]
        share = 1.0 - np.divide(links, level, out=np.zeros_like(links), where=level > 0.0)
        return np.asarray(share * out[self._at.velocity])

    def advance(self, command: Vector | None) -> None:
        """Advances by one control period; the arguments are those of ``Plant.advance``.

        Raises:
            PlantNotFinite: A number of the state is not finite; the plant must be reset.
        """
        queue = self._running()
        if command is not None:
            self._standing = None
            issued: Order | None = Order(Mode.TORQUE, checked_effort(command, self.model.n))
        else:
            issued = self._standing
        self._obey(queue.acting, queue.exchange(issued))
        before = self._motor_before
        for loop in range(self._division.loops):
            self._robot_loop(self.time + loop * self._division.loop)
        self._periods += 1
        self._motor_before = self.motor_position
        self.motor_work += float(self._command @ (self._motor_before - before))

    def _robot_loop(self, time: float) -> None:
        """Advances by one loop of the robot: its weight compensation, drives, pushes, MuJoCo's steps, its sensors."""
        if self._weight.acts:
            self._assist[:] = self._weight.torque(self._sensors.position)
        self._set_drives()
        for body, pushes in self._pushes:
            self.data.xfrc_applied[body.index] = body.at_centre(
                self.data, push_wrench(pushes, body.name, time)
            )
        before = self.velocity
        mujoco.mj_step(self._physics, self.data, self._division.steps)
        self._refuse_non_finite(time, before)
        self._sensors.update(self.encoder_position)

    def _set_drives(self) -> None:
        """Gives the actuators command and weight compensation, through the drives' path where a patch has one."""
        drive, ctrl = self._worn.drive, self._ctrl
        if drive is None:
            ctrl[self._at.command], ctrl[self._at.assist] = self._command, self._assist
            return
        motion = self._motion()
        ctrl[self._at.command] = motion.drive + drive.torque(motion) - self._assist
        ctrl[self._at.assist] = self._assist
        drive.settle(motion)

    def _motion(self) -> JointMotion:
        """What the drives' path reads: the command that acts, and with it what the robot adds by itself."""
        self._seen.time = self.time
        np.add(self._command, self._assist, out=self._seen.drive)
        return self._seen

    def _refuse_non_finite(self, time: float, before: Vector) -> None:
        """Refuses a state that has left every scale of a robot."""
        if math.isfinite(total := float(self._v @ self._v + self._q @ self._q)) and total < HUGE**2:
            return
        wrong = ~(np.abs(np.concatenate([self.velocity, self.position])) < HUGE)
        names = [f"{what} of {name}" for what in ("velocity", "position") for name in self.model.joint_names]
        first = names[int(np.argmax(wrong))] if wrong.any() else "velocity of the object"
        fastest = int(np.argmax(np.abs(before)))
        raise PlantNotFinite(
            f"the simulated {first} is not finite at {time + self._division.loop:.4f} s in MuJoCo; before it,"
            f" {self.model.joint_names[fastest]} moved at {abs(before[fastest]):.4g} rad/s"
        )

    def hold(self) -> None:
        """Orders the robot's own position mode: it keeps the joints where they are when this arrives."""
        self._standing = Order(Mode.HOLD, np.zeros(self.model.n))

    def release(self) -> None:
        """Orders zero torque: the robot carries only the arms' weight, if it does that at all."""
        self._standing = Order(Mode.RELEASE, np.zeros(self.model.n))

    def _obey(self, before: Order, order: Order) -> None:
        """Sets the torques of the order that acts in this period."""
        if order is before:
            return
        self._command[:] = order.effort
        if order.mode is before.mode:
            return
        stiffness, damping = np.zeros(self.model.n), np.zeros(self.model.n)
        if order.mode is Mode.HOLD:
            own = self.model.mass_matrix(self.position) - np.diag(self.model.reflected_inertia)
            stiffness, damping = hold_gains(self.model, np.asarray(np.linalg.inv(own), dtype=float))
        self._hold_gains(stiffness, damping)
        self.data.ctrl[self._at.hold] = self.data.qpos[self._at.motor_position]

    def _hold_gains(self, stiffness: Vector, damping: Vector) -> None:
        """Writes the gains (n,), (n,) of the position hold into its actuators: K (q_0 - q) - D v."""
        at, physics = self._at.hold, self._physics
        physics.actuator_gainprm[at, 0] = stiffness
        physics.actuator_biasprm[at, 1], physics.actuator_biasprm[at, 2] = -stiffness, -damping

    def _running(self) -> CommandQueue:
        if self._queue is None:
            raise NotConnected(
                "the robot on MuJoCo has not been reset: call reset(q) with a start posture first"
            )
        return self._queue


def _motor_losses(
    physics: mujoco.MjModel, worn: WornEffects, scene: MujocoScene
) -> tuple[Array, Array, Array]:
    """Gives inertia, damping and drag (n,) that act on rigid joints' motors, without what acts on their links."""
    at = scene.indices.motor_velocity
    damping = physics.dof_damping[at] - worn.joints.damping[LINK]
    return physics.dof_armature[at].copy(), damping, physics.dof_dampingpoly[at, 0] - worn.joints.drag[LINK]


class PushedBody:
    """A body that is pushed: a limb's hand or the held object.

    Attributes:
        name: As the task calls it.
        index: Of MuJoCo's body.
    """

    def __init__(self, name: str, index: int, site: int | None) -> None:
        """Takes name, body, and the site at which the wrench acts; None for the body's own origin."""
        self.name, self.index, self._site = name, index, site

    def at_centre(self, data: mujoco.MjData, wrench: Vector) -> Vector:
        """Moves a wrench (6,), world axes [N], [N.m], from where it acts to the body's centre of mass."""
        origin = data.xpos[self.index] if self._site is None else data.site_xpos[self._site]
        out = wrench.copy()
        out[3:] += np.cross(origin - data.xipos[self.index], wrench[:3])
        return out


def _pushed_bodies(
    model: RobotModel, scene: MujocoScene, pushes: Sequence[PushSpec]
) -> list[tuple[PushedBody, tuple[PushSpec, ...]]]:
    """Finds the bodies that a task pushes, each with its pushes.

    Raises:
        BadInput: A push is on something that is not there.
    """
    mounts = dict(zip(model.limbs, scene.mounts, strict=True))
    found = []
    for name in dict.fromkeys(push.target for push in pushes):
        own = tuple(push for push in pushes if push.target == name)
        if name in mounts:
            mount = mounts[name]
            site = scene.compiled.site(f"{OWN}hand/{mount.frame}").id
            found.append((PushedBody(name, scene.compiled.body(mount.body).id, site), own))
        elif scene.grasp is not None:
            found.append((PushedBody(name, scene.compiled.body(f"{OWN}object").id, None), own))
        else:
            valid = tuple(mounts)
            raise BadInput(
                f"nothing to push is called '{name}'{nearest(name, valid)} (valid: {', '.join(valid)})"
            )
    return found
