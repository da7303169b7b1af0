# SPDX-License-Identifier: BSD-3-Clause
r"""A robot's own joint boards: position servo, velocity mode, brake and collision detection, and a plant under them.

    tau_m    = command + assist + clip(K_s (theta_s - theta) - D_s w, effort_max)
    tau_link = push + preload - k q

The servo acts on the motor's side. It is what a robot's own position and velocity modes, its hold and, with
K_s = 0, a passive brake are made of. The robot's help with the arms' weight can be switched off joint by joint.
Pushes and built-in springs act on the links; both are held over one period. The servo's reference moves in a tick T:

    POSITION      eased' = clip(target - eased, +-ratio v_max T),  reference' = (eased - reference) T / lag
    RAW_POSITION  reference' = clip(target - reference, +-v_max T)
    VELOCITY      reference' = clip(v, +-v_max) T
    hold          reference stays

    theta_s = reference + integral of error + weight / K_sea + v_ref D_s / K_s - ease (v - v_ref)

The weight deflects the joint's own spring, so the motor must stand ahead of the link; the integral takes the rest.
``ease`` = 0.4 sqrt(M_ii / K_sea) feeds the link's speed back, or the arm would swing on its springs for seconds.

A torque from outside counts as a collision when it is sudden, or when it goes on pressing:

    impact: |tau - low pass of tau| > threshold        squish: |tau| > threshold, for a while

tau is the torque from outside on the joints of one limb. A robot judges it from its torque sensors and its model; here
the plant knows it, so that no quick motion of its own is taken for a collision.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.plant.joints import structural_stiffness
from impedance_modules.plant.plant import Plant, PlantOptions, no_effects
from impedance_modules.records import Record, Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import ParallelSpringSpec
from impedance_modules.spec.task import SurfaceSpec

NOTHING = 1e-6
"""What has faded below this is over [N.m]."""


@dataclass(frozen=True)
class BoardOrders:
    """What the joint boards are told for one period, all (n,).

    Attributes:
        effort: Torque command [N.m], beyond what the robot adds by itself.
        stiffness, damping: Of the servo, K_s [N.m/rad] and D_s [N.m.s/rad]; zero where there is none.
        position: Where it pulls the motor to, theta_s [rad].
        assisted: 1.0 where the robot carries the arm's weight and its parallel springs, else 0.0.
    """

    effort: Vector
    stiffness: Vector
    damping: Vector
    position: Vector
    assisted: Vector


class TorqueState(Record):
    """Torque (n,) [N.m] on the links that is the same at every stage of a period."""

    torque: Vector


@compiled
def add_steady_torque(state: TorqueState, motion: JointMotion, torque: Vector) -> None:  # noqa: ARG001 - as all
    """Adds it."""
    for i in range(torque.size):
        torque[i] += state.torque[i]


class LinkTorque(CompiledTorque):
    """A torque on the links that somebody else changes."""

    port: Literal["motor", "link"] = "link"
    law = add_steady_torque

    def __init__(self, torque: Vector) -> None:
        """Takes an array (n,) [N.m] that may change."""
        self.state = TorqueState(torque=torque)


class DrivenPlant(Plant):
    """Simulated reality under a robot that has control modes of its own.

    ``drive`` replaces ``advance``; ``hold`` and ``release`` are left alone: whoever drives the boards decides them.
    Orders act one command delay after they were given, torque and servo alike.

    Attributes:
        push: (n,) torque of the surroundings on the joints [N.m]; write to push.
    """

    def __init__(
        self,
        model: RobotModel,
        options: PlantOptions,
        effects: PlantEffects | None,
        springs: dict[str, ParallelSpringSpec],
        surfaces: Sequence[SurfaceSpec] = (),
    ) -> None:
        """Builds the plant.

        Args:
            model: The robot.
            options: How it is stepped.
            effects: What reality does beyond the model; None for nothing.
            springs: Joint -> spring beside it that the robot knows and compensates with the weight.
            surfaces: Its surroundings.
        """
        effects = no_effects(model) if effects is None else effects
        places = [model.joint_names.index(name) for name in springs]
        self._stiffness, self._preload = np.zeros(model.n), np.zeros(model.n)
        self._stiffness[places] = [spring.stiffness for spring in springs.values()]
        self._preload[places] = [spring.preload for spring in springs.values()]
        self.push: Vector = np.zeros(model.n)
        self._on_links = np.zeros(model.n)
        self._boards: deque[BoardOrders] = deque()
        known = replace(
            effects,
            spring_stiffness=effects.spring_stiffness + self._stiffness,
            spring_preload=effects.spring_preload + self._preload,
            torques=(*effects.torques, LinkTorque(self._on_links)),
        )
        super().__init__(model, surfaces, None, options, known)

    def reset(self, q: Vector) -> None:
        """Puts everything at rest at q (n,) [rad], the weight carried (see ``Plant.reset``)."""
        self._weight.share = np.ones(self.model.n)
        self._on_links[:] = self._springs(q)
        super().reset(q)
        nothing = np.zeros(self.model.n)
        at_rest = BoardOrders(self.start_command.copy(), nothing, nothing, q.copy(), np.ones(self.model.n))
        self._boards = deque([at_rest] * self.delay)

    def widen_stops(self, by: float) -> None:
        """Moves the mechanical stops beyond the declared limits by an angle [rad]."""
        self.state.joints["lower"] -= by
        self.state.joints["upper"] += by

    def servo_gains(self) -> tuple[Vector, Vector]:
        """Gives a servo as stiff as the joints' own springs, critically damped for the rotors alone, (n,) each."""
        stiffness = np.array([structural_stiffness(joint) for joint in self.model.joints])
        return stiffness, 2.0 * np.sqrt(stiffness * self.model.rotor_inertia)

    def contact_torque(self) -> Vector:
        """Gives the torque of all surfaces on the joints (n,) [N.m], of the last step."""
        wrench = self.state.contact_wrench[:-1]
        return np.asarray(np.einsum("hri,hr->i", self.state.jacobian, wrench))

    def compensation(self, position: Vector) -> tuple[Vector, Vector]:
        """Gives what the robot would add for the links' weight and for the springs it knows (n,), (n,) [N.m]."""
        springs = self._effects.spring_stiffness * position - self._effects.spring_preload
        return self._weight.full(position) - springs, springs

    def drive(self, orders: BoardOrders) -> None:
        """Advances by one period under the orders of one command delay ago, and takes new ones."""
        self._boards.append(orders)
        acting = self._boards.popleft()
        joints = self.state.joints
        joints["hold_stiffness"], joints["hold_damping"] = acting.stiffness, acting.damping
        joints["hold_position"] = acting.position
        self._weight.share = acting.assisted
        np.add(self.push, self._springs(self.state.start.position), out=self._on_links)
        self.advance(orders.effort)

    def _springs(self, position: Vector) -> Vector:
        """Computes the torque of the built-in springs on the joints (n,) [N.m]."""
        return self._preload - self._stiffness * position


@dataclass(frozen=True)
class ServoTuning:
    """How a robot's own modes are tuned.

    Attributes:
        tick: Period of the robot's own loop [s].
        lag: By which position mode trails a moving command [s].
        integral_rate, integral_limit: Integral action of the position servo [1/s] and its limit [rad].
    """

    tick: float
    lag: float
    integral_rate: float
    integral_limit: float


@dataclass(frozen=True)
class JointRange:
    """How far and how fast a limb's joints go, each (k,): [rad], [rad], [rad/s]."""

    low: Vector
    high: Vector
    speed: Vector


@dataclass(frozen=True)
class Sensed:
    """A limb's measured positions (k,) [rad] and velocities (k,) [rad/s]."""

    position: Vector
    velocity: Vector


@dataclass(frozen=True)
class Servo:
    """How a limb's servo is set, each (k,).

    Attributes:
        ahead: By how much the weight deflects the joints' springs [rad].
        lead: D_s / K_s [s].
        ease: Of the links' swing [s].
    """

    ahead: Vector
    lead: Vector
    ease: Vector


class ServoReference:
    """The moving set-point of one limb's servo.

    Attributes:
        position: (k,) where the links shall be [rad].
        velocity: (k,) how fast it moves [rad/s].
        integral: (k,) of the position error times the integral rate [rad].
    """

    def __init__(self, reach: JointRange, tuning: ServoTuning) -> None:
        self._reach, self._tuning = reach, tuning
        self._catching_up = 1.0 - math.exp(-tuning.tick / tuning.lag)
        k = reach.speed.size
        self.position, self.velocity, self.integral = np.zeros(k), np.zeros(k), np.zeros(k)
        self._eased = np.zeros(k)

    def settle(self, position: Vector) -> None:
        """Starts to hold at measured positions (k,) [rad]."""
        self.position = position.copy()
        self._eased = position.copy()
        self.velocity[:] = 0.0
        self.integral[:] = 0.0

    def stay(self) -> None:
        """Holds."""
        self.velocity[:] = 0.0
        self._eased = self.position.copy()

    def approach(self, target: Vector, ratio: float) -> None:
        """Moves on in position mode at a share of the top speed."""
        target = np.clip(target, self._reach.low, self._reach.high)
        step = ratio * self._reach.speed * self._tuning.tick
        self._eased = self._eased + np.clip(target - self._eased, -step, step)
        self._move(self._catching_up * (self._eased - self.position))

    def follow(self, target: Vector) -> None:
        """Moves on in raw position mode: only the joints' top speed is kept."""
        step = self._reach.speed * self._tuning.tick
        self._move(np.clip(target - self.position, -step, step))
        self._eased = self.position.copy()

    def run(self, velocity: Vector) -> None:
        """Moves on in velocity mode, up to the limits."""
        bounded = np.clip(velocity, -self._reach.speed, self._reach.speed)
        goal = np.clip(self.position + bounded * self._tuning.tick, self._reach.low, self._reach.high)
        self._move(goal - self.position)
        self._eased = self.position.copy()

    def motor_target(self, sensed: Sensed, servo: Servo) -> Vector:
        """Computes theta_s (k,) [rad].

        Args:
            sensed: What the joints report.
            servo: How the joints' servo is set.
        """
        tuning = self._tuning
        self.integral += tuning.integral_rate * tuning.tick * (self.position - sensed.position)
        np.clip(self.integral, -tuning.integral_limit, tuning.integral_limit, out=self.integral)
        swing = sensed.velocity - self.velocity
        ahead = servo.ahead + servo.lead * self.velocity - servo.ease * swing
        return np.asarray(self.position + self.integral + ahead)

    def _move(self, step: Vector) -> None:
        self.position = self.position + step
        self.velocity = step / self._tuning.tick


@dataclass(frozen=True)
class CollisionLimits:
    """When a limb has collided.

    Attributes:
        impact, squish: (k,) sudden and steady torque that count [N.m]; infinite where nothing is monitored.
        impact_time: Time constant of the low pass behind the one [s].
        squish_time: Duration of the other [s].
        tick: Between two samples [s].
    """

    impact: Vector
    squish: Vector
    impact_time: float
    squish_time: float
    tick: float


class CollisionDetector:
    """Detects impacts and squeezes of one limb."""

    def __init__(self, limits: CollisionLimits) -> None:
        self._limits = limits
        self._fade = 1.0 - math.exp(-limits.tick / limits.impact_time)
        self._slow = np.zeros(limits.impact.size)
        self._pressed = 0.0

    @property
    def idle(self) -> bool:
        """Whether nothing has pressed lately."""
        return not self._slow.any() and self._pressed == 0.0

    def detect(self, torque: Vector) -> str:
        """Takes the torque (k,) [N.m] of one tick; returns ``impact``, ``squish`` or nothing."""
        sudden = np.abs(torque - self._slow)
        self._slow = self._slow + self._fade * (torque - self._slow)
        self._slow[np.abs(self._slow) < NOTHING] = 0.0
        pressed = bool((np.abs(torque) > self._limits.squish).any())
        self._pressed = self._pressed + self._limits.tick if pressed else 0.0
        if (sudden > self._limits.impact).any():
            return "impact"
        return "squish" if self._pressed >= self._limits.squish_time else ""
