# SPDX-License-Identifier: BSD-3-Clause
r"""A robot that plays a recorded joint path back by itself, in its own position or velocity mode.

A server compares every joint ``rate`` times a second with its path q_d(t), whose clock never waits:

    position mode   |q_d - q| >= tolerance ends the playback: the limbs hold where they are;
                    else the joints are commanded to q_d, at a share of their top speed
    velocity mode   the joints are commanded the speed gain (q_d - q); nothing ends it

A limb that collides holds where it is and takes no commands for a while, in either mode. Neither the
torque filter nor the energy tank has a part in this: the joint boards' own servos move the arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.plant.joint_servos import (
    BoardOrders,
    CollisionDetector,
    CollisionLimits,
    DrivenPlant,
    JointRange,
    Sensed,
    Servo,
    ServoReference,
    ServoTuning,
)
from impedance_modules.records import Vector
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot_spec import PlaybackSpec

TICK = 1e-3
"""Period of the robot's own loop [s]: the rate at which a ``DrivenPlant`` for a playback must run."""

INERTIA_TICKS = 100
"""The servos get the arms' inertia every so many ticks."""


class PlaybackMode(Enum):
    """Which of the robot's own modes plays the path."""

    POSITION = "position"
    VELOCITY = "velocity"


@dataclass(frozen=True)
class JointPath:
    """A recorded joint path: times (N,) [s], ascending from 0, and positions (N, n) [rad]; straight between them."""

    time: Vector
    position: Vector

    def __post_init__(self) -> None:
        ascending = self.time.size >= 2 and bool((np.diff(self.time) > 0.0).all())
        if (
            not ascending
            or self.position.shape[:1] != self.time.shape
            or not np.isfinite(self.position).all()
        ):
            raise BadInput("a joint path needs two or more finite postures at ascending times")

    @property
    def duration(self) -> float:
        """From its first posture to its last [s]."""
        return float(self.time[-1] - self.time[0])

    def at(self, time: float) -> Vector:
        """Gives the posture (n,) at a time since its start [s]; before and after, its first and last."""
        when = float(np.clip(time + self.time[0], self.time[0], self.time[-1]))
        after = min(max(int(np.searchsorted(self.time, when)), 1), self.time.size - 1)
        share = (when - self.time[after - 1]) / (self.time[after] - self.time[after - 1])
        return np.asarray((1.0 - share) * self.position[after - 1] + share * self.position[after])


class _LimbPlayer:
    """One limb's servo and its collision detector."""

    def __init__(self, model: RobotModel, limb: Limb, spec: PlaybackSpec) -> None:
        self.joints = limb.joints
        specs = [model.spec.joints[name] for name in limb.joint_names]
        reach = JointRange(
            np.array([joint.position_min for joint in specs]),
            np.array([joint.position_max for joint in specs]),
            np.array([joint.velocity_max for joint in specs]),
        )
        self.reference = ServoReference(
            reach, ServoTuning(TICK, spec.position_lag, spec.integral_rate, spec.integral_limit)
        )
        limits = CollisionLimits(
            impact=np.array([spec.impact.get(short, math.inf) for short in limb.short_names]),
            squish=np.array([spec.squish.get(short, math.inf) for short in limb.short_names]),
            impact_time=spec.impact_time,
            squish_time=spec.squish_time,
            tick=TICK,
        )
        self.detector = CollisionDetector(limits)
        self.pause_end = -math.inf


class Playback:
    """Plays one path on a plant, tick by tick.

    Attributes:
        plant: What really happens.
        state: What the sensors said last.
        wanted: (n,) where the path is [rad].
        stopped: Why it gave up; empty while it has not.
        collisions: (time, limb, ``impact`` or ``squish``) of every pause that began.
        now: Since the start [s].
    """

    def __init__(self, plant: DrivenPlant, path: JointPath, mode: PlaybackMode, limbs: Sequence[str]) -> None:
        """Builds it; ``start`` comes next.

        Args:
            plant: Running at 1 / TICK.
            path: Of all joints.
            mode: Of the robot.
            limbs: Which play; the others hold the path's first posture.

        Raises:
            BadInput: The robot file does not say how this robot plays anything back.
        """
        spec = plant.model.spec.playback
        if spec is None:
            raise BadInput(f"robot '{plant.model.spec.name}' has no 'playback' in its robot file")
        self.plant, self.path, self.mode, self._spec = plant, path, mode, spec
        self._limbs = {name: _LimbPlayer(plant.model, limb, spec) for name, limb in plant.model.limbs.items()}
        self._playing = tuple(limbs)
        self._joints = np.concatenate([self._limbs[name].joints for name in self._playing])
        self._stiffness, self._damping = plant.servo_gains()
        self._ease, self._ahead = np.zeros(plant.model.n), np.zeros(plant.model.n)
        self._every = max(1, round(1.0 / (spec.rate * TICK)))
        self._ticks = 0
        self.now = 0.0
        self.stopped = ""
        self.collisions: list[tuple[float, str, str]] = []
        self.wanted: Vector = path.at(0.0)
        self._command: Vector = np.zeros(plant.model.n)

    def start(self) -> RobotState:
        """Stands at the path's first posture; returns the first sample."""
        self.plant.warm(self.path.at(0.0))
        self.state: RobotState = self.plant.sense()
        for limb in self._limbs.values():
            limb.reference.settle(self.path.at(0.0)[limb.joints])
        self._update_inertia()
        return self.state

    @property
    def done(self) -> bool:
        """Whether the path has been played to its end, or given up."""
        return bool(self.stopped) or self.now >= self.path.duration

    def tick(self) -> RobotState:
        """Advances by one millisecond; returns what the sensors say at its end."""
        if not self.stopped and self._ticks % self._every == 0:
            self._serve()
        self.plant.drive(self._orders())
        self.state = self.plant.sense()
        self._ticks += 1
        self.now = self._ticks * TICK
        if self._ticks % INERTIA_TICKS == 0:
            self._update_inertia()
        return self.state

    def paused(self, limb: str) -> bool:
        """Whether a collision makes a limb ignore its commands."""
        return self.now < self._limbs[limb].pause_end

    def _serve(self) -> None:
        """Compares the joints with the path, and commands them or gives up."""
        self.wanted = self.path.at(self.now)
        away = self.wanted - self.state.position
        if self.mode is PlaybackMode.VELOCITY:
            self._command = self._spec.velocity_gain * away
            return
        self._command = self.wanted
        beyond = np.abs(away[self._joints]) >= self._spec.position_tolerance
        if beyond.any():
            worst = self._joints[int(np.argmax(np.abs(away[self._joints])))]
            self.stopped = (
                f"{self.plant.model.joint_names[worst]} is {abs(away[worst]):.3f} rad from its path (at most "
                f"{self._spec.position_tolerance:g} rad) at {self.now:.2f} s"
            )
            for name in self._playing:
                limb = self._limbs[name]
                limb.reference.settle(self.state.position[limb.joints])

    def _orders(self) -> BoardOrders:
        """Moves every limb's servo on and puts the boards' orders together."""
        n = self.plant.model.n
        if self._ticks % self._every == 0:
            weight, springs = self.plant.compensation(self.state.position)
            self._ahead = (weight + springs) / self._stiffness
        ahead, lead = self._ahead, self._damping / self._stiffness
        pressed, position = self.plant.contact_torque(), np.zeros(n)
        for name, limb in self._limbs.items():
            joints = limb.joints
            self._detect_collision(name, limb, pressed[joints])
            self._move(name, limb)
            sensed = Sensed(self.state.position[joints], self.state.velocity[joints])
            servo = Servo(ahead[joints], lead[joints], self._ease[joints])
            position[joints] = limb.reference.motor_target(sensed, servo)
        return BoardOrders(np.zeros(n), self._stiffness, self._damping, position, np.ones(n))

    def _detect_collision(self, name: str, limb: _LimbPlayer, torque: Vector) -> None:
        found = limb.detector.detect(torque)
        if found and not self.paused(name):
            self.collisions.append((self.now, name, found))
            limb.pause_end = self.now + self._spec.pause
            limb.reference.settle(self.state.position[limb.joints])

    def _move(self, name: str, limb: _LimbPlayer) -> None:
        if self.stopped or name not in self._playing or self.paused(name):
            limb.reference.stay()
        elif self.mode is PlaybackMode.POSITION:
            limb.reference.approach(self._command[limb.joints], self._spec.speed_ratio)
        else:
            limb.reference.run(self._command[limb.joints])

    def _update_inertia(self) -> None:
        model = self.plant.model
        inertia = np.diag(model.mass_matrix(self.state.position)) - model.reflected_inertia
        self._ease = self._spec.swing_feedback * np.sqrt(inertia / self._stiffness)
