# SPDX-License-Identifier: BSD-3-Clause
r"""Motion of joints: what an effect's law is a function of, and what the plant passes to an effect's torque.

A `JointSample` is read by the same law twice: the plant hands over one joint at one instant, as a row of ``SAMPLE``,
the diagnosis one joint over a whole recording. Its fields are numbers there and arrays here, all of one shape.

Dry friction can change its sign over a speed, or over a displacement, as bristles that bend (Dahl 1968). Their bend
\zeta follows the path and not the speed,

    d\zeta / dq = (1 - \zeta d)^i / stretch        d = sgn(dq)

which is exact over a displacement in one direction: what lacks of slipping, u = 1 - \zeta d, decreases to u
(1 + (i - 1) u^(i - 1) |dq| / stretch)^(-1 / (i - 1)), for i = 1 to u exp(-|dq| / stretch).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array, Indices
from impedance_modules.compiled import Law, compiled
from impedance_modules.effects.link_poses import PlacedLinks, empty_poses
from impedance_modules.records import Matrix, Record, Scalar, Vector

Shape = Mapping[str, Array | float]
"""Values of the parameters that enter a law nonlinearly, by symbol; numbers or one per joint."""

REGULARISATION_VELOCITY, SLIDING_REGULARISATION_VELOCITY = 0.01, 0.001
"""Regularisation velocity v_0 of dry friction, sgn(v) ~ tanh(v / v_0) [rad/s], and of a sliding joint [m/s].

The diagnosis always uses this one, the plant a larger one where a light link would demand a shorter step.
"""

EXPONENTIAL = 1e-6
"""Exponent of bristles less one below which their bend is an exponential of the displacement, for all that shows."""


SAMPLE = np.dtype(
    [
        ("time", np.float64),
        ("position", np.float64),
        ("velocity", np.float64),
        ("acceleration", np.float64),
        ("load", np.float64),
        ("direction", np.float64),
    ],
    align=True,
)
"""One joint at one instant, as the plant hands it to a law: the fields of ``JointSample``."""


@dataclass(frozen=True)
class JointSample:
    """Motion and torques that a joint's law may depend on.

    Attributes:
        time: Since the start [s].
        position, velocity, acceleration: Of the side at which the effect acts [rad], [rad/s], [rad/s^2];
            the plant, which is still to find the acceleration, gives zeros.
        load: Torque between gear and link [N.m].
        regularisation: Regularisation velocity v_0 of dry friction [rad/s].
        bristles: Bend in [-1, 1] of the bristles, where a displacement and not a speed decides; or None.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    load: Array
    regularisation: Array | float = REGULARISATION_VELOCITY
    bristles: Array | None = None

    @property
    def direction(self) -> Array:
        """The regularised sign of the velocity, or the bend of the bristles."""
        if self.bristles is not None:
            return self.bristles
        return np.asarray(sign.python(self.velocity, self.regularisation))


def regularisation_velocity(sliding: NDArray[np.bool_]) -> Array:
    """Gives each joint's regularisation velocity v_0 (n,) from whether it is prismatic."""
    return np.where(sliding, SLIDING_REGULARISATION_VELOCITY, REGULARISATION_VELOCITY)


@compiled
def sign(velocity: Array | float, regularisation: Array | float = REGULARISATION_VELOCITY) -> Any:
    """Gives the regularised sign tanh(v / v_0); as Python, of arrays too."""
    return np.tanh(velocity / regularisation)


class JointMotion(Record):
    """The joints at one stage, all (n,); read them, do not write. The same object every time, with other numbers.

    Attributes:
        time: Of the step's start [s].
        position, velocity: Of the links [rad], [rad/s].
        motor_position, motor_velocity: Of the rotors, seen at the joint; a rigid joint's are its link's.
        command: Torque command that acts now [N.m].
        load: Torque between gear and link at the step's start [N.m].
        drive: Torque asked of the motors: the command plus what the robot adds by itself [N.m].
        position_command, velocity_command: The joint motion the controller aims at [rad], [rad/s].
        links: Where the links stand.
    """

    time: Scalar
    position: Vector
    velocity: Vector
    motor_position: Vector
    motor_velocity: Vector
    command: Vector
    load: Vector
    drive: Vector
    position_command: Vector
    velocity_command: Vector
    links: PlacedLinks


def joint_motion(n: int, links: PlacedLinks | None = None, **arrays: Array) -> JointMotion:
    """Makes the motion of n joints over arrays of others, by name; those that are not given are new, and zero."""
    missing = {f.name for f in JointMotion._layout.fields if f.ndim} - arrays.keys()
    arrays |= {name: np.zeros(n) for name in missing}
    return JointMotion(time=0.0, links=empty_poses(n) if links is None else links, **arrays)


class JointHistory(Record):
    """Motions one integration step apart, at least one: fields as in ``JointMotion``, (N,) or (N, n).

    Whoever recorded them has no links' poses: nothing that remembers reads those.
    """

    time: Vector
    position: Matrix
    velocity: Matrix
    motor_position: Matrix
    motor_velocity: Matrix
    command: Matrix
    load: Matrix
    drive: Matrix
    position_command: Matrix
    velocity_command: Matrix


@compiled
def take_from_history(history: JointHistory, k: int, motion: JointMotion) -> None:
    """Writes the k-th motion of a history."""
    motion.time = history.time[k]
    motion.position[:] = history.position[k]
    motion.velocity[:] = history.velocity[k]
    motion.motor_position[:] = history.motor_position[k]
    motion.motor_velocity[:] = history.motor_velocity[k]
    motion.command[:] = history.command[k]
    motion.load[:] = history.load[k]
    motion.drive[:] = history.drive[k]
    motion.position_command[:] = history.position_command[k]
    motion.velocity_command[:] = history.velocity_command[k]


class JointTorque(Protocol):
    """An effect that acts as a torque on joints."""

    @property
    def port(self) -> Literal["motor", "link"]:
        """Which of the two equations of motion the torque enters (thesis eq. 3.1 or 3.2)."""
        ...

    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage; must not remember anything."""
        ...

    def settle(self, motion: JointMotion) -> None:
        """Is told the motion at the end of each step; the place for memory such as a stuck bristle."""
        ...


class EffectTorque(ABC):
    """A joint torque of the catalogue: it can start again. Without more said it has no memory."""

    port: Literal["motor", "link"]

    @abstractmethod
    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage; must not remember anything."""

    def start(self, motion: JointMotion, step: float) -> None:  # noqa: B027
        """Forgets the past: the joints are as given, and steps of a length [s] follow."""

    def settle(self, motion: JointMotion) -> None:  # noqa: B027
        """Is told the motion at the end of each step."""


class CompiledTorque(EffectTorque):
    """An effect's torque whose law runs within the plant's step, without a call of Python.

    Attributes:
        law: ``(state, motion, torque)``: adds to a torque (n,) [N.m]; must not remember anything.
        ending: ``(state, motion)``: remembers the motion at the end of each step; None where there is nothing to.
        state: What the two read and write; ``start`` may replace it.
    """

    law: ClassVar[Law[..., None]]
    ending: ClassVar[Law[..., None] | None] = None
    state: Record

    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage."""
        torque = np.zeros(motion.position.size)
        self.prepare()
        self.law(self.state, motion, torque)
        return torque

    def settle(self, motion: JointMotion) -> None:
        """Is told the motion at the end of each step."""
        if self.ending is not None:
            self.ending(self.state, motion)

    def prepare(self) -> None:
        """Brings addresses in the state up to date with the way in which laws run now."""

    def addresses(self, motion: JointMotion) -> tuple[int, int]:
        """Gives the addresses of law and ending, 0 where there is none, as laws run now."""
        self.prepare()
        ending = 0 if self.ending is None else self.ending.address(self.state, motion)
        return self.law.address(self.state, motion, motion.load), ending


@compiled
def bent(bristle: float, moved: float, stretch: float, exponent: float = 1.0) -> Any:
    """Gives the bristles' bend zeta in [-1, 1] after a displacement in one direction."""
    direction = 1.0 if moved >= 0.0 else -1.0
    return direction * (1.0 - unslipped(1.0 - bristle * direction, np.abs(moved) / stretch, exponent))


@compiled
def unslipped(share: Array | float, way: Array | float, exponent: float = 1.0) -> Any:
    """Gives what lacks of slipping, u, after a way in multiples of the stretch; as Python, of arrays too."""
    above = exponent - 1.0
    if above < EXPONENTIAL:
        return share * np.exp(-way)
    return share * (1.0 + above * share**above * way) ** (-1.0 / above)


def follow(position: Array, stretch: float, exponent: float = 1.0) -> Array:
    r"""Computes the bend (N,) along a path (N,), unbent at its start.

    From a reversal at q_r with the bend \zeta_r on, as long as the direction d stays the same, \zeta = d (1 - u), where
    u begins as 1 - \zeta_r d and depends on |q - q_r| alone: only reversals are followed one after the other.

    Args:
        position: The path [rad].
        stretch: Displacement over which bristles bend [rad].
        exponent: i of Dahl's law, at least one.
    """
    out = np.zeros(position.size)
    direction, first = _ways(position)
    if not first.size:
        return out
    turns = np.append(position[first], position[-1])
    ways = np.abs(np.diff(turns)) / stretch
    begins, bend = np.empty(first.size), 0.0
    for i, way in enumerate(direction):
        begins[i] = 1.0 - bend * way
        bend = way * (1.0 - unslipped.python(begins[i], ways[i], exponent))
    lengths = np.diff(np.append(first, position.size - 1))
    way, begin, turn = (np.repeat(x, lengths) for x in (direction, begins, turns[:-1]))
    moved = np.abs(position[first[0] + 1 :] - turn)
    out[first[0] + 1 :] = way * (1.0 - unslipped.python(begin, moved / stretch, exponent))
    return out


def _ways(position: Array) -> tuple[Array, Indices]:
    """Directions of the stretches of a path (N,) between its reversals, and where each begins; rests belong to both.

    Rests at the beginning belong to none.
    """
    steps = np.sign(np.diff(position))
    moving = np.flatnonzero(steps)
    if not moving.size:
        return np.zeros(0), moving
    turned = np.concatenate([[True], np.diff(steps[moving]) != 0.0])
    first = moving[turned]
    return steps[first], first
