# SPDX-License-Identifier: BSD-3-Clause
r"""How the arms follow a probe: joint springs K_j with damping ratio \zeta on the inertia M + I_r at the start.

    (M + I_r) \ddot q + D \dot q + K_j (q - rest) = 0,      D = M_r \Phi diag(2 \zeta \omega) \Phi^T M_r

(thesis eq. 4.25 with the damping of `modules.modal_damping`.) Its modes are each a second-order filter:

    q - q_0 = \Phi \eta,      \ddot\eta_i + 2 \zeta \omega_i \dot\eta_i + \omega_i^2 \eta_i = \omega_i^2 r_i
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.signal import bilinear, lfilter

from impedance_modules.diagnosis.data.rigid_dynamics import mass_matrix
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.experiment_design.strokes import Motion
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.effects.recorded_signals import Signals, differentiate

Array = NDArray[np.float64]

RATE = 50.0
"""Samples per second of a predicted motion [Hz]."""

FREQUENCY = 1.2
"""Of a joint's spring on its own inertia [Hz]: strokes of half a second are still followed."""

RATIO = 0.8
"""Damping ratio of the joint springs."""


@dataclass(frozen=True, eq=False)
class Follower:
    """Predicts recordings of probes from one start.

    Attributes:
        model: What is believed about the robot.
        rigid: Its links.
        start: (n,) [rad].
        stiffness: (n,) K_j [N.m/rad].
        effort_source: Where the robot measures torque.
    """

    model: NominalModel
    rigid: RigidModel
    start: Array
    stiffness: Array
    effort_source: str

    @cached_property
    def _inertia(self) -> Array:
        return _inertia(self.model, self.start)

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """Squared frequencies (n,) and mode shapes (n, n) of the joint springs."""
        squared, modes = eigh(np.diag(self.stiffness), self._inertia)
        return np.asarray(squared), np.asarray(modes)

    def position(self, motion: Motion) -> tuple[Array, Array]:
        """Gives times (N,) [s] and angles (N, n) [rad]."""
        time = np.arange(0.0, motion.duration, 1.0 / RATE)
        squared, modes = self._modes
        asked = (motion.rest(time) - self.start) @ self._inertia @ modes
        for index, omega in enumerate(np.sqrt(squared)):
            numerator, denominator = bilinear([omega**2], [1.0, 2.0 * RATIO * omega, omega**2], RATE)
            asked[:, index] = lfilter(numerator, denominator, asked[:, index])
        return time, self.start + asked @ modes.T

    def record(self, motion: Motion) -> Signals:
        """Predicts what the nominal robot would record of a probe."""
        time, q = self.position(motion)
        v = differentiate(q, time)
        a = differentiate(v, time)
        effort = self.rigid.torque(q, v, a)
        model = self.model
        rotor = model.reflected_inertia * a + model.motor_damping * v
        sensor = self.effort_source == "joint_sensor"
        return Signals(
            model=self.rigid,
            time=time,
            position=q,
            velocity=v,
            acceleration=a,
            effort=effort if sensor else effort + rotor,
            drive=effort + rotor,
            position_command=motion.rest(time),
            reflected_inertia=model.reflected_inertia,
            motor_damping=model.motor_damping,
            effort_source="joint_sensor" if sensor else "motor",
            spring_compliance=model.compliance if sensor else 0.0 * model.compliance,
            assistance=self.rigid.weight(q),
        )


def _inertia(model: NominalModel, start: Array) -> Array:
    return np.asarray(mass_matrix(model.tree, start[None])[0] + np.diag(model.reflected_inertia))


def spring_stiffness(model: NominalModel, start: Array) -> Array:
    r"""Chooses joint springs K_j = (M + I_r)_jj (2 \pi f)^2, (n,) [N.m/rad], to two digits."""
    plain = np.diag(_inertia(model, start)) * (2.0 * np.pi * FREQUENCY) ** 2
    digits = 10.0 ** (np.floor(np.log10(plain)) - 1.0)
    return np.asarray(np.round(plain / digits) * digits)
