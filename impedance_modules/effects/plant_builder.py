# SPDX-License-Identifier: BSD-3-Clause
"""What a patch's effects do to a plant: frozen numbers, torques on joints, and the builder that collects them.

Several effects on one joint add up or follow one another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.joint_motion import (
    EffectTorque,
    JointMotion,
    JointSample,
    Shape,
    regularisation_velocity,
)
from impedance_modules.effects.rigid_model import sliding_joints
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3

Side = Literal["motor", "link"]

FAST = 5.0
"""Multiple of the regularisation velocity at which dry friction is measured."""


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

    def joints(self, names: Iterable[str]) -> NDArray[np.intp]:
        """Finds the indices (k,) of joints by their names."""
        return np.array([self.joint(name) for name in names], dtype=np.intp)

    def add_law(
        self,
        basis: Callable[[JointSample, Shape], Array],
        port: Port,
        names: Sequence[str],
        *,
        coefficients: Array,
        shape: Shape,
    ) -> None:
        """Puts a law of motion on joints, as a torque against them.

        Args:
            basis: What the consumed torque is linear in, (k, p).
            port: ``actuator`` for the motors' side of the gear, else the links'.
            names: Of the k joints.
            coefficients: (k, p).
            shape: Nonlinear parameters, (k,) each.
        """
        side: Side = "motor" if port == "actuator" else "link"
        joints = self.joints(names)
        self.torques.append(
            LawTorque(
                basis,
                side,
                joints,
                coefficients=coefficients,
                shape=shape,
                mobility=self.motor_mobility if side == "motor" else self.link_mobility,
                sliding=sliding_joints(self.model.pin_model)[joints],
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


class LawTorque(EffectTorque):
    """Minus the torque that joints consume by a law of their motion, which has no memory."""

    def __init__(
        self,
        basis: Callable[[JointSample, Shape], Array],
        port: Side,
        joints: NDArray[np.intp],
        *,
        coefficients: Array,
        shape: Shape,
        mobility: Callable[[Array], Array],
        sliding: NDArray[np.bool_],
    ) -> None:
        """Takes the law, its joints' indices (k,), coefficients (k, p), and shape values (k,) each.

        ``mobility`` gives the acceleration per torque (n,) of the port's side at a posture (n,); ``sliding``
        (k,) says which of the law's joints are prismatic.
        """
        self._basis = basis
        self.port = port
        self._joints = joints
        self._coefficients = coefficients
        self._shape = shape
        self._mobility = mobility
        self._usual = regularisation_velocity(sliding)
        self._regularisation = self._usual

    def start(self, motion: JointMotion, step: float) -> None:
        """Raises dry friction's regularisation velocity where it would stop a light part within less than a step.

        Over a step h a torque F changes a speed by F h / I: below that speed no friction of size F can be told
        from sticking, and an explicit integrator would shake.
        """
        usual = replace(self._sample(motion), regularisation=self._usual)
        speed = FAST * self._usual
        there = self._consumed(replace(usual, velocity=speed))
        back = self._consumed(replace(usual, velocity=-speed))
        dry = 0.5 * np.abs(there - back)
        self._regularisation = np.maximum(
            self._usual, dry * self._mobility(motion.position)[self._joints] * step
        )

    def torque(self, motion: JointMotion) -> Array:
        """Evaluates the law (n,) [N.m]."""
        out = np.zeros(motion.position.size)
        out[self._joints] = -self._consumed(self._sample(motion))
        return out

    def _consumed(self, sample: JointSample) -> Array:
        return np.asarray(np.sum(self._basis(sample, self._shape) * self._coefficients, axis=-1))

    def _sample(self, motion: JointMotion) -> JointSample:
        """Picks the joints' motion on their side of the gear."""
        motor = self.port == "motor"
        position = motion.motor_position if motor else motion.position
        velocity = motion.motor_velocity if motor else motion.velocity
        return JointSample(
            time=np.full(self._joints.size, motion.time),
            position=position[self._joints],
            velocity=velocity[self._joints],
            acceleration=np.zeros(self._joints.size),
            load=motion.load[self._joints],
            regularisation=self._regularisation,
        )


class DrivePath(EffectTorque):
    r"""Path of all joints from the torque asked for to the motor's: delayed, clipped, scaled, mixed, lagged.

        u_1(t) = u(t - T_delay)      of the command; what the robot adds by itself is not delayed
        u_2 = min(max(u_1 + assist, -limit), limit)
        u_3 = s u_2 + C u_2
        T_lag \dot\tau_m = u_3 - \tau_m

    Its torque is \tau_m less the torque asked for. The delay is rounded to the plant's integration step.
    """

    port: Side = "motor"

    def __init__(self, delay: Array, limit: Array, gain: Array, crosstalk: Array, lag: Array) -> None:
        """Takes (n,) each: delay [s], symmetric limit [N.m] (inf: none), gain, time constant [s]; C (n, n)."""
        self._delay, self._limit, self._gain, self._lag = delay, limit, gain, lag
        self._crosstalk, self._mixes = crosstalk, bool(crosstalk.any())
        self._age = np.zeros(delay.size, dtype=np.intp)
        self._share = np.ones(delay.size)
        self._past = np.zeros((1, delay.size))
        self._next = 0
        self._slow = np.zeros(delay.size)

    @property
    def does_anything(self) -> bool:
        """Says whether any joint's motor torque differs from the torque asked for."""
        return bool(
            self._delay.any()
            or self._lag.any()
            or self._mixes
            or np.any(self._gain != 1.0)
            or np.isfinite(self._limit).any()
        )

    def start(self, motion: JointMotion, step: float) -> None:
        """Starts as if the present command had acted for ever."""
        self._age = np.rint(self._delay / step).astype(np.intp)
        self._share = np.where(self._lag > 0.0, -np.expm1(-step / np.maximum(self._lag, 1e-12)), 1.0)
        self._past = np.tile(motion.command, (int(self._age.max()) + 1, 1))
        self._next = 0
        self._slow = self._asked(motion)

    def torque(self, motion: JointMotion) -> Array:
        """Gives motor torque minus torque asked for (n,) [N.m]."""
        asked = self._asked(motion)
        # Over a step, a lag moves by its share: half-way is what the step sees on average.
        now = np.where(self._lag > 0.0, self._slow + 0.5 * self._share * (asked - self._slow), asked)
        return np.asarray(now - motion.drive)

    def settle(self, motion: JointMotion) -> None:
        """Advances by one step."""
        self._slow = self._slow + self._share * (self._asked(motion) - self._slow)
        self._past[self._next] = motion.command
        self._next = (self._next + 1) % self._past.shape[0]

    def _asked(self, motion: JointMotion) -> Array:
        """Computes u_3, what the motor's own bandwidth then follows."""
        n = self._delay.size
        late = self._past[(self._next - self._age) % self._past.shape[0], np.arange(n)]
        command = np.where(self._age > 0, late, motion.command)
        total = command + (motion.drive - motion.command)
        clipped = np.clip(total, -self._limit, self._limit)
        given = self._gain * clipped
        return np.asarray(given + self._crosstalk @ clipped if self._mixes else given)
