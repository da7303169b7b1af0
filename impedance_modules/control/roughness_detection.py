# SPDX-License-Identifier: BSD-3-Clause
r"""Windows of a rubbing motion, and what the force in each says (thesis 5.2.4).

A stroke begins where the hand starts to move in the chosen direction a; its window is the 0.8 s from there, so that it
holds both the breaking away and the sliding. In a window of samples f_k, N of them:

    f(\nu) = 2 / N |FFT(detrended f . a)|         amplitude spectrum of the tangential force [N]
    band   = (\sum_{15..25 Hz} f(\nu)^2 / 2)^(1/2)         its root mean square around 20 Hz [N]
    \mu    = -mean(f . a) / mean(f . n)                    coefficient of friction

f is what the surface does to the hand, n the surface's outward normal. The same samples, one after the other, feed this
while a task runs and when a recording is read.

The force comes from joint efforts, sample by sample and unfiltered:

    J^T w = C(q, v) v + g(q) - \tau_s          w the least-squares solution, J over the hand's limb

The links' own acceleration is left in (the thesis does so too): what shakes the hand shows, as a force, what it takes
to shake it. ``contact_detection.HandWrenches`` takes it out, and with it everything fast.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import SmoothCondition

LENGTH = 0.8
"""Of a window [s]; the thesis's."""

SAMPLE_RATE = 100.0
"""Samples in a second that are looked at."""

BAND = (15.0, 25.0)
"""Around the thesis's 20 Hz [Hz]."""

SETTLING = 0.05
"""Time over which speed is taken [s]."""

START_SPEED = 0.02
"""Above this a stroke has begun [m/s]."""

LEAST_TRAVEL = 0.02
"""A window in which the hand moves less was stuck [m]."""

LEAST_FORCE = 0.5
"""Normal force below which a sample does not touch [N]."""

LEAST_SHARE = 0.6
"""Part of a window's samples that must touch."""

REGULARISATION = 1e-4
"""Added to J J^T [m^2, rad^2]: along a singular direction no force is claimed."""


@dataclass(frozen=True)
class Directions:
    """Unit vectors in world: ``along`` the strokes that are judged, ``normal`` out of the surface, (3,) each."""

    along: Array
    normal: Array


def way_of(text: str) -> Array:
    """Reads a signed axis, e.g. ``-x``, as a unit vector (3,).

    Raises:
        BadInput: It is none.
    """
    axis = text.lstrip("+-")
    if axis not in ("x", "y", "z") or len(text) > 2:
        raise BadInput(f"'{text}' is no direction (valid: x, -x, y, -y, z, -z)")
    way = np.zeros(3)
    way["xyz".index(axis)] = -1.0 if text.startswith("-") else 1.0
    return way


@dataclass(frozen=True)
class Window:
    """One window.

    Attributes:
        start: When it began [s].
        band: Root mean square of the tangential force around 20 Hz [N].
        friction: Coefficient, mean tangential over mean normal force.
        normal: Mean normal force [N].
        travel: How far the hand went [m].
        spectrum: (m,) amplitudes of the tangential force [N].
    """

    start: float
    band: float
    friction: float
    normal: float
    travel: float
    spectrum: Array


def frequencies(rate: float = SAMPLE_RATE) -> Array:
    """Gives the frequencies (m,) of a window's spectrum [Hz]."""
    return np.asarray(np.fft.rfftfreq(round(LENGTH * rate), 1.0 / rate), dtype=np.float64)


def measure(start: float, position: Array, force: Array, ways: Directions, rate: float) -> Window:
    """Says what N samples of position and force (N, 3) tell, taken at a rate [Hz]."""
    along, normal = force @ ways.along, force @ ways.normal
    amplitude = 2.0 / len(along) * np.abs(np.fft.rfft(_detrended(along)))
    nu = np.fft.rfftfreq(len(along), 1.0 / rate)
    inside = (nu >= BAND[0]) & (nu <= BAND[1])
    return Window(
        start=start,
        band=float(np.sqrt(np.sum(amplitude[inside] ** 2) / 2.0)),
        friction=float(-np.mean(along) / max(float(np.mean(normal)), 1e-9)),
        normal=float(np.mean(normal)),
        travel=float((position[-1] - position[0]) @ ways.along),
        spectrum=amplitude,
    )


def _detrended(values: Array) -> Array:
    """Takes the straight line out that fits best."""
    ramp = np.linspace(-1.0, 1.0, len(values))
    return np.asarray(values - values.mean() - ramp * float(ramp @ values / (ramp @ ramp)))


class WindowFinder:
    """Takes samples one by one, evenly in time, and gives each window when it is full.

    Attributes:
        refused: How many strokes gave no window, by why.
    """

    def __init__(self, ways: Directions, rate: float = SAMPLE_RATE) -> None:
        """Takes the directions that count and the samples' rate [Hz]."""
        self._ways = ways
        self._rate = rate
        self._steps = max(1, round(SETTLING * rate))
        self._recent: deque[Array] = deque(maxlen=self._steps + 1)
        self._samples: list[tuple[Array, Array]] = []
        self._began = 0.0
        self._armed = False
        self.refused: Counter[str] = Counter()

    def add(self, time: float, position: Array, force: Array) -> Window | None:
        """Takes a sample: time [s], position of the hand (3,) [m], force of the surface on it (3,) [N]."""
        self._recent.append(position.copy())
        if self._samples:
            return self._collect(position, force)
        if len(self._recent) <= self._steps:
            return None
        speed = float((self._recent[-1] - self._recent[0]) @ self._ways.along) * self._rate / self._steps
        if speed <= START_SPEED:
            self._armed = True
        elif self._armed:
            self._armed = False
            self._began = time
            self._samples.append((position.copy(), force.copy()))
        return None

    def _collect(self, position: Array, force: Array) -> Window | None:
        self._samples.append((position.copy(), force.copy()))
        if len(self._samples) < round(LENGTH * self._rate):
            return None
        places, forces = (np.array(column) for column in zip(*self._samples, strict=True))
        self._samples.clear()
        touching = forces @ self._ways.normal > LEAST_FORCE
        window = measure(self._began, places, forces, self._ways, self._rate)
        if np.mean(touching) < LEAST_SHARE:
            self.refused["out of contact"] += 1
        elif window.travel < LEAST_TRAVEL:
            self.refused["stuck"] += 1
        else:
            return window
        return None


class HandForce:
    """Position of a hand and force on it, from one state after another."""

    def __init__(self, model: RobotModel, limb: Limb) -> None:
        """Takes the robot and the limb whose hand it is."""
        self._model = model
        self._limb = limb
        self._kinematics = Kinematics(model, (limb.hand,))

    def of(self, position: Array, velocity: Array, effort: Array) -> tuple[Array, Array]:
        """Returns where the hand is (3,) [m] and the force on it (3,) [N], world axes.

        Args:
            position: (n,) [rad].
            velocity: (n,) [rad/s].
            effort: (n,) between gears and links [N.m].
        """
        self._kinematics.update(position, velocity)
        jacobian = self._kinematics.jacobian_of(self._limb.hand)[:, self._limb.joints]
        held = self._kinematics.bias + self._model.gravity(position)
        torque = (held - effort)[self._limb.joints]
        gram = jacobian @ jacobian.T + REGULARISATION * np.eye(6)
        wrench: Array = np.asarray(np.linalg.solve(gram, jacobian @ torque), dtype=np.float64)
        return self._kinematics.pose(self._limb.hand).translation.copy(), wrench[:3]


class SmoothJudge:
    """Smooth is a surface over which the last windows, on average, stay below a bound, or below both.

    Attributes:
        found: Of every window so far, what is compared with the bound [N] or [1].
        frictions: Of every window so far, the coefficient of friction.
    """

    def __init__(self, condition: SmoothCondition, model: RobotModel, period: float) -> None:
        """Takes the condition, the robot, and the time between two looks [s]."""
        self._condition = condition
        self._force = HandForce(model, model.limbs[condition.target])
        ways = Directions(way_of(condition.along), way_of(condition.normal))
        self._finder = WindowFinder(ways, 1.0 / period)
        self.found: list[float] = []
        self.frictions: list[float] = []

    def met(self, state: RobotState) -> bool:
        """Takes the newest state into account; call once per look."""
        position, force = self._force.of(state.position, state.velocity, state.effort)
        window = self._finder.add(state.time, position, force)
        if window is None:
            return False
        self.found.append(window.band if self._condition.by == "spectrum" else window.friction)
        self.frictions.append(window.friction)
        if not self._stays_below(self.found, self._condition.below):
            return False
        also = self._condition.friction_below
        return also is None or self._stays_below(self.frictions, also)

    def account(self) -> str:
        """Says what was measured over the last windows, what is asked for, and since how many."""
        condition, count = self._condition, len(self.found)
        if count < condition.windows:
            return f"{count} windows of a rubbing stroke were seen, {condition.windows} are asked for"
        unit = " N around 20 Hz" if condition.by == "spectrum" else " of friction"
        last = float(np.mean(self.found[-condition.windows :]))
        text = f"the last {condition.windows} of {count} windows have {last:.3g}{unit}, below {condition.below:g}"
        text += " is asked for"
        if condition.friction_below is not None:
            rubs = float(np.mean(self.frictions[-condition.windows :]))
            text += f"; friction {rubs:.3g}, below {condition.friction_below:g} is asked for"
        return text

    def _stays_below(self, found: list[float], bound: float) -> bool:
        """Says whether the last windows do, on average."""
        last = found[-self._condition.windows :]
        return len(last) == self._condition.windows and float(np.mean(last)) < bound
