# SPDX-License-Identifier: BSD-3-Clause
r"""What a hinge exerts about its axis in the quasi-static prediction: the plant's law, solved implicitly.

Over a step s the hinge's rate is w = w_0 + m \tau(\phi + s w, w): w_0 without the torque, m what a torque adds, \tau
the law of ``plant.hinge_forces``. \tau falls with w, so there is exactly one solution, between w_0 and w_0 + m \tau at
w_0.
"""

from __future__ import annotations

from dataclasses import dataclass

from impedance_modules.modules.held_object import HeldObject
from impedance_modules.plant.hinge_forces import (
    FRICTION_STIFFNESS,
    STOP_STIFFNESS,
    HingeState,
    axis_torque,
    within,
)
from impedance_modules.plant.hinge_start import hinge_state
from impedance_modules.plant.rigid_object import ObjectBody

CLOSE = 1e-12
"""Largest error of a hinge's rate [rad/s]."""

TRIES = 60
"""Of the search for the rate."""


@dataclass(frozen=True)
class AxisLoad:
    """What acts about the axis at rest.

    Attributes:
        torque: On the object [N.m].
        stiffness: Minus its derivative by the angle [N.m/rad].
    """

    torque: float
    stiffness: float


class HingeResistance:
    """A hinge's return spring, dampers, friction and stops along a predicted motion.

    Attributes:
        state: Of the plant's law; ``friction_rest`` is where friction has slipped to [rad].
        loss: Energy lost in friction and damping in the last step [J].
    """

    def __init__(self, held: HeldObject) -> None:
        self.state: HingeState = hinge_state(ObjectBody(held.spec, held.hands))
        if held.hinge is not None:
            self.state.angle = self.state.friction_rest = held.hinge.spec.angle
        self.loss = 0.0

    def solve(self, free: float, lightness: float, step: float) -> float:
        """Gives the torque about the axis [N.m] at the end of a step [s] from ``state.angle``.

        Args:
            free: Rate of the hinge without that torque [rad/s].
            lightness: What a torque adds to it [rad/(N.m.s)].
            step: Length [s].
        """
        angle = self.state.angle

        def torque(rate: float) -> float:
            return float(axis_torque(self.state, angle + step * rate, rate))

        low, high = free, free + lightness * torque(free)
        at_low, at_high = free - high, lightness * (torque(free) - torque(high))
        for _ in range(TRIES):
            if abs(high - low) < CLOSE or at_low == at_high:
                break
            rate = high - at_high * (high - low) / (at_high - at_low)
            error = rate - free - lightness * torque(rate)
            if error * at_high <= 0.0:
                low, at_low = high, at_high
            else:
                at_low *= 0.5
            high, at_high = rate, error
            if error == 0.0:
                break
        return torque(high)

    def holds(self, angle: float) -> bool:
        """Tells whether friction sticks or a stop holds at an angle [rad]: both are stiff."""
        state = self.state
        bent = FRICTION_STIFFNESS * abs(angle - state.friction_rest)
        return bent < state.friction or angle > state.upper or angle < state.lower

    def follow(self, angle: float, step: float) -> None:
        """Takes over the angle [rad] that the hinge has come to in a step [s]; friction may have slipped."""
        state = self.state
        rate = (angle - state.angle) / step if step > 0.0 else 0.0
        before, state.angle = state.friction_rest, angle
        state.friction_rest = self.slipped(angle)
        self.loss = state.friction * abs(state.friction_rest - before) + state.damping * rate**2 * step

    def slipped(self, angle: float) -> float:
        """Gives where the rest of friction is [rad] once the hinge has come to an angle [rad]."""
        bent = within(angle - self.state.friction_rest, self.state.friction / FRICTION_STIFFNESS)
        return angle - bent

    def at_rest(self, angle: float, friction_rest: float | None) -> AxisLoad:
        """Gives torque and stiffness at rest at an angle [rad]; friction counts where its rest is known."""
        state, before = self.state, self.state.friction_rest
        state.friction_rest = angle if friction_rest is None else friction_rest
        torque, stiffness = axis_torque(state, angle, 0.0), state.stiffness
        if friction_rest is not None and FRICTION_STIFFNESS * abs(angle - friction_rest) < state.friction:
            stiffness += FRICTION_STIFFNESS
        if angle > state.upper or angle < state.lower:
            stiffness += STOP_STIFFNESS
        state.friction_rest = before
        return AxisLoad(float(torque), stiffness)
