# SPDX-License-Identifier: BSD-3-Clause
r"""A joint's law on the plant: minus the torque that joints consume by their motion, without memory.

    \tau_i = -\sum_p c_{ip} \phi_p(t, q_i, v_i, load_i, sgn(v_i))

Over a step h a torque F changes a speed by F h / I: below that speed no friction of size F can be told from sticking,
and an explicit integrator would shake. There dry friction's regularisation velocity is raised to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.compiled import Law, call, compiled
from impedance_modules.effects.joint_motion import (
    SAMPLE,
    CompiledTorque,
    EffectTorque,
    JointMotion,
    JointSample,
    Shape,
    regularisation_velocity,
    sign,
)
from impedance_modules.records import Flag, Indices, Integer, Matrix, Record, Table, Vector, new_table

Side = Literal["motor", "link"]

Basis = Callable[[JointSample, Shape], Array]
"""What the consumed torque is linear in, (k, p)."""

FAST = 5.0
"""Multiple of the regularisation velocity at which dry friction is measured."""


@dataclass(frozen=True, eq=False)
class LawOnJoints:
    """A law of motion and the joints that have it.

    Attributes:
        basis: The law.
        side: Of the gear at which it acts.
        joints: (k,) indices.
        coefficients: (k, p).
        shape: Nonlinear parameters, (k,) each.
        mobility: Gives the acceleration per torque (n,) of the side at a posture (n,) [1/(kg.m^2)].
        sliding: (k,) which of the joints are prismatic.
    """

    basis: Basis
    side: Side
    joints: NDArray[np.int64]
    coefficients: Array
    shape: Shape
    mobility: Callable[[Array], Array]
    sliding: NDArray[np.bool_]

    def consumed(self, sample: JointSample) -> Array:
        """Computes the torque (k,) that the joints consume [N.m]."""
        return np.asarray(np.sum(self.basis(sample, self.shape) * self.coefficients, axis=-1))

    def sample(self, motion: JointMotion, regularisation: Array) -> JointSample:
        """Picks the joints' motion on their side of the gear."""
        motor = self.side == "motor"
        position = motion.motor_position if motor else motion.position
        velocity = motion.motor_velocity if motor else motion.velocity
        return JointSample(
            time=np.full(self.joints.size, motion.time),
            position=position[self.joints],
            velocity=velocity[self.joints],
            acceleration=np.zeros(self.joints.size),
            load=motion.load[self.joints],
            regularisation=regularisation,
        )

    def regularisation(self, motion: JointMotion, step: float) -> Array:
        """Gives the velocity v_0 (k,) with which steps of a length [s] stay smooth [rad/s]."""
        usual = regularisation_velocity(self.sliding)
        sample = self.sample(motion, usual)
        there, back = (self.consumed(replace(sample, velocity=side * FAST * usual)) for side in (1.0, -1.0))
        dry = 0.5 * np.abs(there - back)
        return np.maximum(usual, dry * self.mobility(motion.position)[self.joints] * step)


class PythonLawTorque(EffectTorque):
    """A law that has no compiled text: Python evaluates it before each stage."""

    def __init__(self, law: LawOnJoints) -> None:
        self._law = law
        self.port = law.side
        self._regularisation = regularisation_velocity(law.sliding)

    def start(self, motion: JointMotion, step: float) -> None:
        """Raises the regularisation velocity where the step demands it."""
        self._regularisation = self._law.regularisation(motion, step)

    def torque(self, motion: JointMotion) -> Array:
        """Evaluates the law (n,) [N.m]."""
        out = np.zeros(motion.position.size)
        out[self._law.joints] = -self._law.consumed(self._law.sample(motion, self._regularisation))
        return out


class JointLawState(Record):
    """A compiled law and its joints.

    Attributes:
        law: Address of ``(sample, shape, columns)``.
        motor: Whether it acts on the motors' side of the gear.
        joints: (k,) indices.
        coefficients: (k, p).
        shape: (k, s) nonlinear parameters.
        regularisation: (k,) velocity v_0 [rad/s].
        sample: (1,) of ``SAMPLE``: the joint at hand.
        columns: (p,) its columns.
    """

    law: Integer
    motor: Flag
    joints: Indices
    coefficients: Matrix
    shape: Matrix
    regularisation: Vector
    sample: Annotated[Table, SAMPLE]
    columns: Vector


@compiled
def take_consumed(state: JointLawState, motion: JointMotion, torque: Vector) -> None:
    """Subtracts the torque that the joints consume [N.m]."""
    position = motion.motor_position if state.motor else motion.position
    velocity = motion.motor_velocity if state.motor else motion.velocity
    sample, columns = state.sample[0], state.columns
    sample.time, sample.acceleration = motion.time, 0.0
    for k in range(state.joints.size):
        i = state.joints[k]
        sample.position, sample.velocity, sample.load = position[i], velocity[i], motion.load[i]
        sample.direction = sign(velocity[i], state.regularisation[k])
        call(state.law, sample, state.shape[k], columns)
        for p in range(columns.size):
            torque[i] -= columns[p] * state.coefficients[k, p]


class LawTorque(CompiledTorque):
    """A law with a compiled text."""

    law = take_consumed

    def __init__(self, text: Law[..., None], on: LawOnJoints) -> None:
        """Takes the text ``(sample, shape, columns)`` of the law's basis."""
        self._text, self._on = text, on
        self.port = on.side
        k, p = on.coefficients.shape
        self.state: JointLawState = JointLawState(
            law=0,
            motor=on.side == "motor",
            joints=np.array(on.joints, dtype=np.int64),
            coefficients=np.array(on.coefficients, dtype=float),
            shape=np.array(list(on.shape.values()), dtype=float).reshape(-1, k).T.copy(),
            regularisation=regularisation_velocity(on.sliding),
            sample=new_table(1, SAMPLE),
            columns=np.zeros(p),
        )

    def start(self, motion: JointMotion, step: float) -> None:
        """Raises the regularisation velocity where the step demands it."""
        self.state.regularisation[:] = self._on.regularisation(motion, step)

    def prepare(self) -> None:
        """Looks the text's address up."""
        state = self.state
        state.law = self._text.address(state.sample[0], state.shape[0], state.columns)
