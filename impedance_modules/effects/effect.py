# SPDX-License-Identifier: BSD-3-Clause
r"""An effect with its two faces: worn by plant and model, searched for in a recording.

A searched effect is a regression. For given values of the parameters that enter nonlinearly (its *shape*),
the torque that the real joint consumes beyond the nominal model is

    r = fixed + columns @ coefficients

and ``values`` turns coefficients into the effect's own parameters. Where those differ from the shape they
came from (a delay, a payload's centre), the regression is repeated with the new shape: Gauss-Newton.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Description, Port
from impedance_modules.effects.joint_motion import JointSample, Shape, regularisation_velocity
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.residual_kinds import COVERS, STAGE_OF_PORT, Residual, Stage
from impedance_modules.spec.robot_spec import RobotSpec

Array = NDArray[np.float64]
Values = Mapping[str, float]
"""An effect's parameters by symbol, in the units of its description."""

PAIR = "<-"
"""Between the two joints of a key: ``JOINT<-OTHER``."""


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


class Effect(ABC):
    """One entry of the catalogue.

    Attributes:
        description: In words.
        shape: Names of what enters nonlinearly; empty for a linear effect.
        replaces: It replaces a number of the robot file instead of adding to it.
        nearly_linear: Linearised where its shape starts it is good enough to be found by; it moves once it is accepted.
        brief: It may show in a few moments only, by its nature.
        symmetric: On a pair of joints it is the same effect either way round.
        contrasts: Sums of coefficients that differ from zero if it is this effect and not a simpler one.
    """

    description: Description
    shape: tuple[str, ...] = ()
    replaces: bool = False
    nearly_linear: bool = False
    brief: bool = False
    symmetric: bool = False
    contrasts: tuple[tuple[float, ...], ...] = ()

    @property
    def id(self) -> str:
        """Of the contract."""
        return self.description.id

    def stage(self, port: Port) -> Stage | None:
        """Names the stage that consumes the torque; None for what is only reported wrongly."""
        return STAGE_OF_PORT.get(port)

    def shows(self, port: Port, residual: Residual) -> bool:
        """Says whether the effect at this port can be seen in a residual."""
        return self.stage(port) in COVERS[residual]

    def relations(self, values: Values) -> list[str]:
        """Lists violated relations between an effect's own numbers, in words."""
        return []

    @abstractmethod
    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Computes the columns in one residual; None where the effect cannot show or is not recorded."""

    def out_of_reach(self, coefficients: Array, spread: Array, reach: float) -> str | None:
        """Says why coefficients (p,), known to (p,), ask for a place beyond a reach [m]; None where they do not."""
        return None

    def unresolved(self, shape: Shape, resolution: float) -> str | None:
        """Says why a shape cannot be seen through a position sensor's grid [rad]; None where it can."""
        return None

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Proposes the shapes to try; one empty shape for a linear effect."""
        return ({},)

    def coefficients(
        self, values: Values, signals: Signals, key: str, port: Port
    ) -> tuple[Array, dict[str, float]]:
        """Turns parameters into the regression's coefficients and the shape in which they are meant.

        Unless said otherwise the coefficients are the parameters outside the shape, zero where left out.
        """
        return self.linear(values)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Does the same where neither the nominal model nor the port matters."""
        coefficients = np.array([values.get(name, 0.0) for name in self.free])
        return coefficients, {name: values[name] for name in self.shape}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """Turns a regression's result into the effect's parameters."""
        found = dict(zip(self.free, map(float, coefficients), strict=True))
        return {
            name: found[name] if name in found else float(shape[name]) for name in self.description.symbols
        }

    @property
    def free(self) -> tuple[str, ...]:
        """Symbols that are coefficients of the regression."""
        return tuple(symbol for symbol in self.description.symbols if symbol not in self.shape)

    def next_shape(self, values: Values, shape: Mapping[str, float]) -> dict[str, float]:
        """Gives the shape for the next round of the regression; the same one when it has converged."""
        return {name: values.get(name, old) for name, old in shape.items()}

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Returns the robot as the effect changes its numbers: what both plant and model know."""
        return robot

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:  # noqa: B027
        """Tells the plant what reality does and the model does not know."""


PRESLIDING = "way"
"""Shape: displacement over which dry friction turns over [rad]; zero where it turns over a speed."""

PRESLIDING_DISPLACEMENTS = (0.03, 0.1, 0.2)
"""Displacements tried, in multiples of the distance that the regularisation's speed goes in a second."""

REGULARISATION = "turn"
"""Shape: how much wider than usual the speed is over which dry friction turns over; missing where it is not."""

WIDER_REGULARISATIONS = (3.0, 7.0)
"""Multiples tried: wet surfaces creep before they slide, and so do the constraints of simulators."""


class JointLaw(Effect):
    """A torque that one joint consumes by a law of its own motion.

    The law is written once, as ``basis``: plant and diagnosis both evaluate it. How dry friction turns over at a
    reversal is no part of a law that is ``dry``: the diagnosis tries it over a speed and over a short way.

    Attributes:
        dry: Whether it asks for the sign of the speed.
    """

    dry: bool = False

    @abstractmethod
    def basis(self, sample: JointSample, shape: Shape) -> Array:
        """Computes what the consumed torque is linear in, (..., p)."""

    def bounds(self) -> tuple[Array, Array]:
        """Physical bounds of the coefficients."""
        count = len(self.free)
        return np.zeros(count), np.full(count, np.inf)

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Evaluates the law over a recording."""
        if not self.shows(port, residual):
            return None
        joint = signals.joint(key)
        sample = signals.sample(joint, motor_side=port == "actuator")
        way = float(shape.get(PRESLIDING, 0.0))
        if way > 0.0:
            sample = replace(sample, bristles=signals.bristles(joint, way, motor_side=port == "actuator"))
        turn = float(shape.get(REGULARISATION, 0.0))
        if turn > 0.0:
            sample = replace(sample, regularisation=turn * sample.regularisation)
        return one_row(joint, self.basis(sample, shape), None, *self.bounds())

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """One empty shape, or both with_reversal_shapes in which dry friction may turn over."""
        return self.with_reversal_shapes(signals, key, ({},))

    def with_reversal_shapes(
        self, signals: Signals, key: str, shapes: tuple[dict[str, float], ...]
    ) -> tuple[dict[str, float], ...]:
        """Lets every shape of a dry law turn over a speed, and over a way; a law of one number over wider speeds."""
        if not self.dry:
            return shapes
        second = float(regularisation_velocity(signals.model.sliding)[signals.joint(key)])
        over_ways = [{**shape, PRESLIDING: way * second} for way in PRESLIDING_DISPLACEMENTS for shape in shapes]
        return (
            *shapes,
            *over_ways,
            *({REGULARISATION: turn} for turn in WIDER_REGULARISATIONS if len(self.description.symbols) == 1),
        )

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Puts the same law on the plant's joints, as a torque against the motion."""
        builder.add_law(self, port, parameters)


def predicted(
    effect: Effect, signals: Signals, key: str, port: Port, *, residual: Residual, values: Values
) -> Array:
    """Computes what an effect with known parameters adds to a residual, (N, n); zero where it does not show."""
    total = np.zeros((signals.samples, signals.n))
    coefficients, shape = effect.coefficients(values, signals, key, port)
    found = effect.regressor(signals, key, port, residual, shape)
    if found is not None:
        total[:, list(found.rows)] += found.torque(coefficients)
    return total


def unbounded(count: int) -> tuple[Array, Array]:
    """Gives bounds that allow every coefficient."""
    return np.full(count, -np.inf), np.full(count, np.inf)


def one_row(joint: int, columns: Array, fixed: Array | None, lower: Array, upper: Array) -> Regressor:
    """Makes a regressor of one joint from columns (N, p) and a fixed part (N,)."""
    steady = np.zeros(columns.shape[0]) if fixed is None else fixed
    return Regressor((joint,), columns[:, None, :], steady[:, None], lower, upper)


class Stepped(Effect):
    """An effect whose shape is all of its numbers; its coefficients are steps from them."""

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The shape says it all."""
        return np.zeros(len(self.shape)), {name: values[name] for name in self.shape}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The shape plus the step."""
        return {name: float(shape[name] + step) for name, step in zip(self.shape, coefficients, strict=True)}
