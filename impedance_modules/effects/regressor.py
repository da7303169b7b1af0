# SPDX-License-Identifier: BSD-3-Clause
r"""A place in a recording where an effect is looked for, and the effect's torque there as a regression.

    r = fixed + columns @ coefficients

is the torque that the real joints consume beyond the nominal model, in one residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.joint_motion import JointSample
from impedance_modules.effects.recorded_signals import Signals

Bound = float | Sequence[float] | Array
"""Bound of all coefficients of a regression, or of each of them."""

PAIR = "<-"
"""Between the two joints of a key: ``JOINT<-OTHER``."""


@dataclass(frozen=True)
class Site:
    """Where in a recording an effect is looked for.

    Attributes:
        signals: The recording.
        key: Joint, pair of joints, link, ``base``, ``log`` or surface that carries the effect's numbers.
        port: Where it acts.
        all_travel: From its joint's least to its greatest position in all recordings; None: this is the only one.
    """

    signals: Signals
    key: str
    port: Port
    all_travel: float | None = None

    @property
    def joint(self) -> int:
        """Column of the joint that the key names."""
        return self.signals.joint(self.key)

    @property
    def travel(self) -> float:
        """From the joint's least to its greatest position in all recordings [rad]."""
        own = float(np.ptp(self.signals.position[:, self.joint]))
        return own if self.all_travel is None else self.all_travel

    def sample(self) -> JointSample:
        """The joint's motion on the side of its gear at which the effect acts."""
        return self.signals.sample(self.joint, motor_side=self.port == "actuator")

    def bristles(self, stretch: float, exponent: float) -> Array:
        """Bend (N,) of bristles that slip within a displacement [rad] by Dahl's law, on the same side."""
        return self.signals.bristles(self.joint, stretch, exponent, motor_side=self.port == "actuator")


@dataclass(frozen=True)
class Regressor:
    """An effect's torque in one residual, for one shape.

    Attributes:
        rows: Joints whose residual it enters.
        columns: (N, rows, p); the coefficients are common to all rows.
        fixed: (N, rows) part that has no coefficient.
        lower, upper: (p,) physical bounds of the coefficients.
    """

    rows: tuple[int, ...]
    columns: Array
    fixed: Array
    lower: Array
    upper: Array

    def torque(self, coefficients: Array) -> Array:
        """Evaluates the regression, (N, rows) [N.m], or [rad/s] in the velocity residual."""
        return np.asarray(self.fixed + self.columns @ coefficients)


def one_row(
    joint: int, columns: Array, fixed: Array | None = None, lower: Bound = 0.0, upper: Bound = np.inf
) -> Regressor:
    """Makes a regressor of one joint from one column (N,) or columns (N, p), and a fixed part (N,)."""
    columns = columns.reshape(len(columns), 1, -1)
    steady = np.zeros(columns.shape[:2]) if fixed is None else fixed[:, None]
    return _bounded((joint,), columns, steady, lower, upper)


def all_rows(
    columns: Array, fixed: Array | None = None, lower: Bound = -np.inf, upper: Bound = np.inf
) -> Regressor:
    """Makes a regressor of all joints from columns (N, n, p) and a fixed part (N, n)."""
    steady = np.zeros(columns.shape[:2]) if fixed is None else fixed
    return _bounded(tuple(range(columns.shape[1])), columns, steady, lower, upper)


def _bounded(rows: tuple[int, ...], columns: Array, fixed: Array, lower: Bound, upper: Bound) -> Regressor:
    count = columns.shape[2]
    return Regressor(rows, columns, fixed, np.full(count, lower), np.full(count, upper))


def ends(key: str) -> tuple[str, str]:
    """Splits the key ``JOINT<-OTHER`` of a pair."""
    joint, _, other = key.partition(PAIR)
    return joint, other
