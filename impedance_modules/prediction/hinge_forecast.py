# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` foretells of an object's hinge in each phase: how far it turns, what resists, what it bears."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_modules.modules.equilibrium import OBJECT_TARGETS
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.modules.hinge import Hinge
from impedance_modules.plant.hinge_forces import FRICTION_STIFFNESS
from impedance_modules.prediction.hinge_resistance import HingeResistance
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import PredictedPhase
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import rotation_angle
from impedance_modules.superposition.object_impedance import HeldImpedance

TURNS = 2e-3
"""Angle from which a hinge counts as turned [rad], beyond what the spring of its friction gives way."""

OFF_ARC = 1e-3
"""Distance of the object's target from the hinge's arc from which it is noted [m]; and angle [rad]."""


@dataclass(frozen=True)
class HingeForecast:
    """The hinge in one phase.

    Attributes:
        began, ended: Its predicted angle at the phase's ends [rad].
        target: Angle of the object's target at the end [rad].
        torque: What resists about the axis at the end [N.m]: hands and weight exert as much the other way.
        friction: Up to which friction holds [N.m].
        bearing: Force of hands and weight on the bearing at rest [N]; None without a rest.
        off_arc: How far the object's target is from the hinge's arc at the end, [m] and [rad].
        stop: ``lower`` or ``upper`` where a stop holds it at the end; None elsewhere.
        driven: Whether the phase moves the object's target.
    """

    began: float
    ended: float
    target: float
    torque: float
    friction: float
    bearing: float | None
    off_arc: tuple[float, float]
    stop: str | None
    driven: bool

    @property
    def turns(self) -> bool:
        """Whether the hinge turns in this phase at all."""
        return abs(self.ended - self.began) > TURNS + 2.0 * self.friction / FRICTION_STIFFNESS


def forecast_hinge(
    mechanism: Mechanism, phase: PredictedPhase, began: float, held: HeldImpedance | None
) -> HingeForecast | None:
    """Sums up the hinge in one phase; None for a task without one.

    Args:
        mechanism: Of the task.
        phase: Predicted.
        began: Angle where the phase begins [rad].
        held: The object's sum at the phase's rest; None without a rest.
    """
    object_held, target = mechanism.modules.held, phase.equilibrium.object
    if object_held is None or object_held.hinge is None or target is None:
        return None
    hinge = object_held.hinge
    mechanism.update(phase.q, np.zeros_like(phase.q))
    ended, _ = mechanism.hinge_motion()
    load = HingeResistance(object_held).at_rest(ended, phase.friction_rest)
    spec = hinge.spec
    stop = "upper" if ended > spec.upper else "lower" if ended < spec.lower else None
    return HingeForecast(
        began=began,
        ended=ended,
        target=hinge.angle(target),
        torque=load.torque,
        friction=spec.friction,
        bearing=None if held is None else _bearing(object_held, held),
        off_arc=off_arc(hinge, target),
        stop=stop,
        driven=bool(set(OBJECT_TARGETS) & set(phase.motion.moved)),
    )


def off_arc(hinge: Hinge, target: Pose) -> tuple[float, float]:
    """Gives how far a target of the object is from where the hinge lets it be at the same angle, [m] and [rad]."""
    on_arc = hinge.object_pose(hinge.angle(target))
    tilt = rotation_angle((target.rotation @ on_arc.rotation.T)[None])
    return float(np.linalg.norm(target.translation - on_arc.translation)), float(tilt[0])


def hinge_notes(phase: str, found: HingeForecast) -> Iterator[str]:
    """Says what the task's author should know of the hinge in one phase."""
    if found.driven and not found.turns and abs(found.target - found.ended) > TURNS:
        holds = (
            f"the {found.stop} stop holds it"
            if found.stop
            else f"friction holds up to {found.friction:.2f} N.m"
        )
        yield (
            f"phase '{phase}': the hinge does not turn: the hands exert {abs(found.torque):.2f} N.m about its axis,"
            f" {holds}"
        )
    elif found.stop is not None:
        yield f"phase '{phase}': the hinge comes to its {found.stop} stop, at {found.ended:.3f} rad"
    away, tilt = found.off_arc
    if away > OFF_ARC or tilt > OFF_ARC:
        pressed = (
            "" if found.bearing is None else f"; the hands then press {found.bearing:.1f} N on its bearing"
        )
        yield (
            f"phase '{phase}': the object's target ends {1e3 * away:.1f} mm and {tilt:.3f} rad off the hinge's"
            f" arc{pressed} (a target 'hinge' follows the arc)"
        )


def _bearing(held: HeldObject, found: HeldImpedance) -> float:
    return float(np.linalg.norm(held.bearing_force(found.impedance.wrench)))
