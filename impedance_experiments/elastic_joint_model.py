# SPDX-License-Identifier: BSD-3-Clause
r"""One series-elastic joint, fourth order, and the second-order model that leaves its spring out.

    link    M v'   = K (\theta - q) + B (w - v) + \tau_ext
    motor   I_r w' = \tau_m - D w - K (\theta - q) - B (w - v)          (thesis 3.10, with the spring's damping)
    reduced (M + I_r) v' = \tau_m + \tau_ext - D v                      (thesis 3.12)

State (q, \theta, v, w). Outputs are velocities: a port is the pair of a torque and the velocity it works on,
and it is passive where the real part of its mobility is nowhere negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impedance_modules.arrays import Array

Complex = NDArray[np.complex128]
RIGID_TOLERANCE = float(np.sqrt(2.0))
"""Ratio of magnitudes up to which the reduced model counts as true (3 dB)."""


@dataclass(frozen=True)
class SeriesElasticJoint:
    r"""A joint whose motor drives its link through a spring.

    Attributes:
        link_inertia: M, of the link about the joint [kg.m^2].
        reflected_inertia: I_r, of the rotor behind its gears [kg.m^2].
        spring_stiffness: K [N.m/rad].
        motor_damping: D [N.m.s/rad].
        spring_damping: B [N.m.s/rad].
    """

    link_inertia: float
    reflected_inertia: float
    spring_stiffness: float
    motor_damping: float
    spring_damping: float

    @property
    def system(self) -> Array:
        """(4, 4) S of x' = S x + T u, x = (q, theta, v, w)."""
        K, B = self.spring_stiffness, self.spring_damping
        M, I_r, D = self.link_inertia, self.reflected_inertia, self.motor_damping
        return np.array(
            [
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
                [-K / M, K / M, -B / M, B / M],
                [K / I_r, -K / I_r, B / I_r, -(B + D) / I_r],
            ]
        )

    @property
    def inputs(self) -> Array:
        """(4, 2) T, for u = (external torque on the link, motor torque)."""
        torques = np.zeros((4, 2))
        torques[2, 0], torques[3, 1] = 1.0 / self.link_inertia, 1.0 / self.reflected_inertia
        return torques

    @property
    def poles(self) -> Complex:
        """(4,) eigenvalues of S [rad/s], slowest first."""
        values = np.linalg.eigvals(self.system).astype(np.complex128)
        return values[np.argsort(np.abs(values), kind="stable")]

    @property
    def elastic_frequency(self) -> float:
        r"""Frequency [rad/s] at which link and rotor swing against each other, sqrt(K (1/M + 1/I_r))."""
        return float(
            np.sqrt(self.spring_stiffness * (1.0 / self.link_inertia + 1.0 / self.reflected_inertia))
        )

    @property
    def rotor_frequency(self) -> float:
        """Frequency [rad/s] of the rotor on its spring with the link held, sqrt(K / I_r): a zero at the link."""
        return float(np.sqrt(self.spring_stiffness / self.reflected_inertia))

    def mobility(self, frequency: ArrayLike) -> Complex:
        r"""Computes velocities per torque, G(j \omega) = C (j \omega I - S)^-1 T.

        Args:
            frequency: (m,) \omega [rad/s], above 0.

        Returns:
            (m, 2, 2) [rad/s per N.m]: rows link and motor velocity, columns external and motor torque.
        """
        omega = np.atleast_1d(np.asarray(frequency, dtype=float))
        pencil = 1j * omega[:, None, None] * np.eye(4) - self.system
        return np.asarray(np.linalg.solve(pencil, self.inputs.astype(complex))[:, 2:, :])

    def rigid_mobility(self, frequency: ArrayLike) -> Complex:
        r"""Computes the reduced model's velocity per torque, 1 / (j \omega (M + I_r) + D), (m,)."""
        omega = np.atleast_1d(np.asarray(frequency, dtype=float))
        inertia = self.link_inertia + self.reflected_inertia
        return np.asarray(1.0 / (1j * omega * inertia + self.motor_damping), dtype=np.complex128)

    def highest_damping_gain(self, sensed_at_link: bool) -> float:
        r"""Finds the largest b for which the motor torque -b v (link) or -b w (motor) leaves the joint stable.

        At the motor the damper is collocated with its torque and any b is passive: infinite. At the link the
        pair is driven unstable; from Routh's criterion by bisection on the eigenvalues.

        Args:
            sensed_at_link: Whether the damped velocity is the link's.
        """
        if not sensed_at_link:
            return float("inf")
        low, high = 0.0, 1.0
        while self._stable_with(high):
            low, high = high, 2.0 * high
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._stable_with(middle) else (low, middle)
        return low

    def _stable_with(self, gain: float) -> bool:
        """Whether nothing grows under the motor torque -gain times the link's velocity; q itself is free."""
        loop = self.system - gain * np.outer(self.inputs[:, 1], [0.0, 0.0, 1.0, 0.0])
        # q and theta only through their difference: without the free drift, whose eigenvalue is 0.
        deflection = np.array([[-1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        reduced = deflection @ loop @ np.linalg.pinv(deflection)
        return bool(np.max(np.linalg.eigvals(reduced).real) < 0.0)


def rigid_up_to(joint: SeriesElasticJoint, motor: bool, tolerance: float = RIGID_TOLERANCE) -> float:
    r"""Finds where the rigid mode stops to dominate the link's motion.

    The lowest frequency [rad/s] at which the fourth-order mobility differs from the reduced one by more than
    ``tolerance`` in magnitude, either way (3 dB).

    Args:
        joint: The joint.
        motor: Whether the motor's torque drives it, else an external one.
        tolerance: Ratio of magnitudes.
    """
    omega = np.geomspace(1e-2, 10.0 * joint.elastic_frequency, 20_000)
    ratio = np.abs(joint.mobility(omega)[:, 0, int(motor)] / joint.rigid_mobility(omega))
    apart = np.abs(np.log(ratio)) > np.log(tolerance)
    return float(omega[np.argmax(apart)])
