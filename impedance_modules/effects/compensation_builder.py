# SPDX-License-Identifier: BSD-3-Clause
r"""What a controller adds against effects that were diagnosed: frozen numbers, and the builder that collects them.

    \tau_c = a + k q + (weight beyond the description)          has a potential, -dU_c/dq
           + tanh(v_d / v_0) F(v_d) + \mu |load| tanh(v_d / v_0)  against friction, v_d the desired velocity
    command = (\tau + \tau_c) / s                               against a motor that gives s times what is asked

F is a table over the speed, for each direction of its own, made from the very law that plant and diagnosis use.
Several effects on one joint add up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.joint_motion import JointSample
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec

SPEEDS = 65
"""Entries of a table over the speed: entry k is at v_max (k / 64)^2, so slow speeds lie close together."""

NORMAL_95 = 1.96
"""Standard deviations from the middle to either end of a 95 % interval."""

SLOWEST = 1e-9
"""Speed at which friction at the onset of motion is read [rad/s]."""


@dataclass(frozen=True)
class IdentifiedNumber:
    """A number of a patch: its value, and its standard deviation, 0 where none was written."""

    value: float
    std: float

    @property
    def low(self) -> float:
        """Lower end of the 95 % interval."""
        return self.value - NORMAL_95 * self.std

    @property
    def high(self) -> float:
        """Upper end of the 95 % interval."""
        return self.value + NORMAL_95 * self.std


IdentifiedNumbers = Mapping[str, IdentifiedNumber]
"""An effect's numbers by symbol."""


@dataclass(frozen=True)
class Diagnosed:
    """One effect of a patch, as a controller may rely on it.

    Attributes:
        numbers: Joint, body or ``base`` -> symbol -> estimate.
        speeds: Joint -> lowest and highest velocity of the data it was fitted to [rad/s]; beyond them friction is
            taken as it was there.
    """

    numbers: Mapping[str, IdentifiedNumbers]
    speeds: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class CompensationNumbers:
    """What the controller adds; n joints.

    Attributes:
        offset, stiffness: (n,) a [N.m] and k [N.m/rad].
        ahead, back: (n, SPEEDS) friction that is overcome in either direction, never negative [N.m].
        per_load: (n,) mu, friction per torque passed on [1].
        gain: (n,) s by which the torque asked for is divided.
        least_gain, most_gain: (n,) ends of the interval in which s lies.
        robot: The described robot with the weights of the patch; None where it changes none.
    """

    offset: Array
    stiffness: Array
    ahead: Array
    back: Array
    per_load: Array
    gain: Array
    least_gain: Array
    most_gain: Array
    robot: RobotSpec | None


class CompensationBuilder:
    """The numbers before they are frozen; effects write into them.

    Attributes:
        model: The robot as it is described.
        offset, stiffness, ahead, back, per_load: See ``CompensationNumbers``.
    """

    def __init__(self, model: RobotModel) -> None:
        n = model.n
        self.model = model
        self.offset, self.stiffness, self.per_load = np.zeros(n), np.zeros(n), np.zeros(n)
        self.ahead, self.back = np.zeros((n, SPEEDS)), np.zeros((n, SPEEDS))
        self._gain, self._least, self._most = np.ones(n), np.ones(n), np.ones(n)
        self._robot: RobotSpec | None = None

    def joint(self, name: str) -> int:
        """Finds a joint's index."""
        return self.model.joint_names.index(name)

    def add_potential(self, name: str, offset: float, stiffness: float) -> None:
        """Adds the torque a + k q on a joint, which has the potential -a q - k q^2 / 2.

        Raises:
            BadInput: The joint has no range, so the potential has no lowest value.
        """
        joint = self.model.joints[self.joint(name)]
        if not (math.isfinite(joint.position_min) and math.isfinite(joint.position_max)):
            raise BadInput(
                f"joint '{name}' has no range, so a torque of this kind has a potential without a lowest value"
            )
        self.offset[self.joint(name)] += offset
        self.stiffness[self.joint(name)] += stiffness

    def add_friction(
        self, name: str, law: Callable[[JointSample], Array], fitted: tuple[float, float] | None
    ) -> None:
        """Tabulates the torque that a joint consumes by a law of its speed, where that is against the motion.

        Args:
            name: Of the joint.
            law: Consumed torque (SPEEDS,) of a sample [N.m].
            fitted: Lowest and highest velocity at which the law was seen [rad/s]; None for any.
        """
        index = self.joint(name)
        speed = speeds(self.model.joints[index].velocity_max)
        low, high = (-math.inf, math.inf) if fitted is None else fitted
        ahead = np.maximum(np.minimum(speed, max(high, 0.0)), SLOWEST)
        back = np.maximum(np.minimum(speed, max(-low, 0.0)), SLOWEST)
        self.ahead[index] += np.maximum(law(_moving(ahead)), 0.0)
        self.back[index] += np.maximum(-law(_moving(-back)), 0.0)

    def divide_by(self, name: str, s: IdentifiedNumber) -> None:
        """Divides a joint's torque by the end of the interval of s that is nearer to 1.

        Raises:
            BadInput: The interval reaches down to zero.
        """
        if s.low <= 0.0:
            raise BadInput(
                f"the 95 % interval of joint '{name}', {s.low:g} to {s.high:g}, reaches zero: what it gives is unknown"
            )
        index = self.joint(name)
        self._gain[index] *= min(max(1.0, s.low), s.high)
        self._least[index] *= s.low
        self._most[index] *= s.high

    def change_weight(self, changed: Callable[[RobotSpec], RobotSpec]) -> None:
        """Changes the links, or gravity's direction, of the robot as it is believed to be."""
        self._robot = changed(self.model.spec if self._robot is None else self._robot)

    def finish(self) -> CompensationNumbers:
        """Freezes the numbers."""
        return CompensationNumbers(
            offset=self.offset,
            stiffness=self.stiffness,
            ahead=self.ahead,
            back=self.back,
            per_load=self.per_load,
            gain=self._gain,
            least_gain=self._least,
            most_gain=self._most,
            robot=self._robot,
        )


def speeds(most: float) -> Array:
    """Gives the speeds (SPEEDS,) of a table up to the largest [rad/s]: most (k / 64)^2."""
    return np.asarray(most * (np.arange(SPEEDS) / (SPEEDS - 1)) ** 2)


def _moving(velocity: Array) -> JointSample:
    """A joint that slides fully at velocities (SPEEDS,), and passes no load on."""
    still = np.zeros_like(velocity)
    return JointSample(still, still, velocity, still, still, regularisation=1e-3 * SLOWEST)
