# SPDX-License-Identifier: BSD-3-Clause
"""A surface that is not where, not as stiff or not as rough as the task says: a poorly mapped environment.

    N = max(0, k d - c n . v) while the depth d of the hand's origin is above 0,   |f_t| = mu N against sliding

A key names a surface by its place in the task's ``environment``: ``surface0`` is the first. All kinds can be applied.
Columns can be computed for planes and boxes where a recording says on which its hands could press
(``Signals.surfaces``, ``hands``); they are the forces on the hand beyond those of the surfaces as the task has them.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import Effect, Stepped, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import SLIDING_REGULARISATION_VELOCITY, Shape
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import SurfaceSpec

NAME = re.compile(r"surface(\d+)")
"""How a patch names a surface."""

PORTS: tuple[Port, ...] = ("contact",)

FLAT_KINDS = ("plane", "box")
"""Surfaces that have the same normal wherever a hand presses on them from above."""


def surface_key(index: int) -> str:
    """Names a surface by its place in the environment."""
    return f"surface{index}"


def surface_index(key: str) -> int | None:
    """Reads the place in the environment from a key; None if it names no surface."""
    match = NAME.fullmatch(key)
    return int(match[1]) if match else None


@dataclass(frozen=True)
class SurfaceTouch:
    """One hand over one surface, along a recording.

    Attributes:
        jacobian: (N, 3, n) of the hand's origin, base axes.
        normal: (3,) out of the surface.
        depth: (N,) below the nominal surface [m], negative above it; minus infinity beside a box.
        closing: (N,) speed into the surface [m/s].
        sliding: (N, 3) velocity along it [m/s].
    """

    jacobian: Array
    normal: Array
    depth: Array
    closing: Array
    sliding: Array

    def pressure(self, surface: SurfaceSpec, raised: float = 0.0) -> Array:
        """Gives N (N,) [N] on a surface that lies higher by some metres."""
        depth = self.depth + self.normal[2] * raised
        force = surface.stiffness * np.maximum(depth, 0.0) + surface.damping * self.closing
        return np.where(depth > 0.0, np.maximum(force, 0.0), 0.0)

    def consumed(self, force: Array) -> Array:
        """Turns a force (N, 3) of the surface on the hand into the torque that the joints consume (N, n)."""
        return np.asarray(-np.einsum("ijk,ij->ik", self.jacobian, force))


def touches(signals: Signals, surface: SurfaceSpec) -> Iterator[SurfaceTouch]:
    """Follows each hand over a surface: a plane, or the top of a box."""
    turn = exp3(np.array(surface.rotation))
    origin, half = np.array([0.0, 0.0, surface.height or 0.0]), np.full(3, np.inf)
    if surface.position is not None and surface.size is not None:
        half = 0.5 * np.array(surface.size)
        origin = np.array(surface.position) + half[2] * turn[:, 2]
    for hand in signals.hands:
        J = signals.model.jacobian(hand, signals.position)[:, :3]
        v = np.einsum("ijk,ik->ij", J, signals.velocity)
        local = (signals.model.place(hand, signals.position) - origin) @ turn
        above = np.all(np.abs(local[:, :2]) <= half[:2], axis=1)
        depth = np.where(above & (-local[:, 2] < 2.0 * half[2]), -local[:, 2], -np.inf)
        along = v @ turn[:, 2]
        yield SurfaceTouch(J, turn[:, 2], depth, -along, v - along[:, None] * turn[:, 2])


class SurfaceEffect(Effect):
    """An error of the task's map of its surroundings: the plant's surface differs from the task's.

    The diagnosis looks for it in rows in contact, where the recording's task has the surface.
    """

    searched = "in_contact"
    not_exported = "it names a surface of a task file, and nothing says which shape of yours that is"
    not_compensated = "a surface is what the hands are to feel (valid: --effects, so that check predicts it)"

    @abstractmethod
    def apply_to_surface(self, surface: SurfaceSpec, values: Values) -> SurfaceSpec:
        """Returns the surface as it really is."""

    @abstractmethod
    def pushes(self, touch: SurfaceTouch, surface: SurfaceSpec, shape: Shape) -> tuple[Array, Array]:
        """Computes the force (N, 3) per unit of the coefficient, and the one that has no coefficient."""

    def nominal(self, site: Site) -> SurfaceSpec | None:
        """Finds the plane or box as the task has it; None where the recording does not say, and for others."""
        index = surface_index(site.key)
        if index is None or index >= len(site.signals.surfaces):
            return None
        surface = site.signals.surfaces[index]
        return surface if surface.surface in FLAT_KINDS and surface.wood is None else None

    def lowest(self, surface: SurfaceSpec) -> float:
        """Gives the coefficient's lower bound."""
        return -np.inf

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Adds up what all hands on the surface consume; None if nothing was touched."""
        surface = self.nominal(site)
        if surface is None:
            return None
        column, fixed = np.zeros((2, site.signals.samples, site.signals.n))
        for touch in touches(site.signals, surface):
            slope, steady = self.pushes(touch, surface, shape)
            column += touch.consumed(slope)
            fixed += touch.consumed(steady)
        return all_rows(column[:, :, None], fixed, self.lowest(surface)) if column.any() else None


class SurfaceHeight(Stepped, SurfaceEffect):
    """A surface that lies higher or lower than the task says."""

    description = Description(
        id="surface_height",
        sentence="A surface lies higher or lower than the task says, so the hand meets it earlier or later.",
        equation="d = d_nominal + n_z dh, d the depth below the surface, n its normal, dh upwards in world",
        parameters=(Parameter("dh", "m", "how much higher it lies", lower=-20.0, upper=20.0),),
        ports=PORTS,
        keys=("surface",),
        signature="a push along the normal wherever the hand is on the surface, and nowhere else",
        confusable_with=("surface_stiffness", "external_contact", "encoder_offset"),
        excitation="the same surface with at least two forces; coming down on it and leaving it",
        reference="Hosford 2016, 5.1: a poorly mapped environment",
        applied="The plant's surface is moved; so are the predictions of `check`. The controller knows no surface.",
    )
    shape = ("dh",)
    starts = (0.0, 0.01, 0.03, 0.1)  # also above the map's: a hand that never reaches it tells nothing

    def pushes(self, touch: SurfaceTouch, surface: SurfaceSpec, shape: Shape) -> tuple[Array, Array]:
        """The push's slope by the height, and its change at the guessed height."""
        pressure = touch.pressure(surface, float(shape["dh"]))
        slope = surface.stiffness * touch.normal[2] * (pressure > 0.0)
        change = pressure - touch.pressure(surface)
        return slope[:, None] * touch.normal, change[:, None] * touch.normal

    def apply_to_surface(self, surface: SurfaceSpec, values: Values) -> SurfaceSpec:
        """Moves it upwards."""
        if surface.position is not None:
            x, y, z = surface.position
            return replace(surface, position=(x, y, z + values["dh"]))
        return replace(surface, height=(surface.height or 0.0) + values["dh"])


class SurfaceNumber(SurfaceEffect):
    """One number of a surface that is not as the task says; fitted as what is beyond the nominal one.

    Attributes:
        symbol: Of the effect's parameter.
        attribute: Of `SurfaceSpec`.
    """

    symbol: str
    attribute: str
    replaces = True

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """What is beyond the nominal number."""
        return np.array([values[self.symbol] - self._nominal_number(site)]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The nominal number and what is beyond it."""
        return {self.symbol: float(coefficients[0]) + self._nominal_number(site)}

    def _nominal_number(self, site: Site) -> float:
        surface = self.nominal(site)
        return 0.0 if surface is None else float(getattr(surface, self.attribute))

    def lowest(self, surface: SurfaceSpec) -> float:
        """What would make the number zero."""
        return -float(getattr(surface, self.attribute))

    def apply_to_surface(self, surface: SurfaceSpec, values: Values) -> SurfaceSpec:
        """Replaces the number."""
        change: dict[str, Any] = {self.attribute: values[self.symbol]}
        return replace(surface, **change)


class SurfaceStiffness(SurfaceNumber):
    """A surface that is harder or softer than the task says."""

    description = Description(
        id="surface_stiffness",
        sentence="A surface is harder or softer than the task says.",
        equation="N = k d - c n . v while d > 0; tau = -J^T n (N - N_nominal)",
        parameters=(Parameter("k", "N/m", "its normal stiffness", lower=0.0, positive=True, upper=1.0e7),),
        ports=PORTS,
        keys=("surface",),
        signature="a push along the normal that grows with the depth, only on the surface",
        confusable_with=("surface_height", "external_contact"),
        excitation="the same place with at least two forces",
        reference="Hosford 2016, 5.1 and 6.2.3; Mills & Lokhorst 1993",
        applied="The plant's surface, tangential stiffness included, and the predictions of `check`.",
    )
    symbol, attribute = "k", "stiffness"

    def pushes(self, touch: SurfaceTouch, surface: SurfaceSpec, shape: Shape) -> tuple[Array, Array]:
        """Depth along the normal, wherever there is any."""
        deep = np.where(touch.pressure(surface) > 0.0, touch.depth, 0.0)
        return deep[:, None] * touch.normal, np.zeros_like(touch.sliding)


class SurfaceFriction(SurfaceNumber):
    """A surface that is rougher or smoother than the task says."""

    description = Description(
        id="surface_friction",
        sentence="A surface is rougher or smoother than the task says.",
        equation="f_t = -mu N v_t/|v_t| while sliding; tau = J^T (mu - mu_nominal) N v_t/|v_t|",
        parameters=(Parameter("mu", "1", "its coefficient of friction", lower=0.0, upper=5.0),),
        ports=PORTS,
        keys=("surface",),
        signature="a drag against sliding that grows with the pressure, only on the surface",
        confusable_with=("coulomb_friction", "load_dependent_friction", "external_contact"),
        excitation="sliding to and fro with at least two forces, and free motion beside it",
        reference="Coulomb's law; Hosford 2016, 5.2",
        applied="The plant's surface and the predictions of `check`.",
    )
    symbol, attribute = "mu", "friction"

    def pushes(self, touch: SurfaceTouch, surface: SurfaceSpec, shape: Shape) -> tuple[Array, Array]:
        """Pressure against the sliding; nothing is known of a hand that sticks."""
        speed = np.linalg.norm(touch.sliding, axis=1)
        share = np.tanh(speed / SLIDING_REGULARISATION_VELOCITY) / np.maximum(speed, 1e-12)
        return -(touch.pressure(surface) * share)[:, None] * touch.sliding, np.zeros_like(touch.sliding)
