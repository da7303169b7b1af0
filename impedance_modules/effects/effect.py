# SPDX-License-Identifier: BSD-3-Clause
r"""The base classes of effects. An effect is used in two ways: applied to plant and model, and searched for.

A searched effect is a regression. For given values of the parameters that enter nonlinearly (its *shape*),
the torque that the real joint consumes beyond the nominal model is

    r = fixed + columns @ coefficients

and ``values`` turns coefficients into the effect's own parameters. Where those differ from the shape they
came from (a delay, a payload's centre), the regression is repeated with the new shape (Gauss-Newton).

Everything that another package wants to know about an effect is an attribute or a method of `Effect`: nobody
asks for an effect by its id. A new effect is a subclass and a line in `catalogue`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import Law
from impedance_modules.effects.compensation_builder import CompensationBuilder, Diagnosed, IdentifiedNumbers
from impedance_modules.effects.dry_reversals import (
    REFINED,
    as_it_reverses,
    nearest_reversal,
    with_reversal_shapes,
)
from impedance_modules.effects.effect_description import Description, Port
from impedance_modules.effects.joint_motion import JointSample, Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Bound, Regressor, Site, one_row
from impedance_modules.effects.residual_kinds import COVERS, STAGE_OF_PORT, Residual, Stage
from impedance_modules.effects.simulator_numbers import Exported
from impedance_modules.spec.robot_spec import EncoderSide, RobotSpec

NEEDED = "needed"
"""Shape: 1 where the torque that the links' motion needs stands in a command's place."""

Values = Mapping[str, float]
"""An effect's parameters by symbol, in the units of its description."""

Compensation = Literal["weight", "potential", "friction", "gain"]
"""How a controller takes an effect back."""


class Effect(ABC):
    """One entry of the catalogue.

    Attributes:
        description: In words.
        shape: Names of what enters nonlinearly; empty for a linear effect.
        replaces: It replaces a number of the robot file instead of adding to it.
        searched: When the diagnosis looks for it: ``always``; only where it is told that the robot was
            ``under_water``; ``in_contact`` with surfaces that the recording's task has; ``while_held``, in samples in
            which hands hold the task's object; ``never``, because no recording by itself can show whose it is.
        nearly_linear: The linearisation at its first shape is good enough to find it; the shape is refined once
            the effect is accepted.
        symmetric: On a pair of joints it is the same effect either way round.
        contrasts: Linear combinations of the coefficients that are zero if a simpler effect would do (Wald test).
        bound_to_recording: It happened at a certain time of one recording: no other recording can confirm it, and it
            says nothing about the robot.
        in_every_drive: One of the laws of one number that every gear and motor has: a model of bare links lacks all
            of them at once.
        deviations: Standard deviations of a wide prior on its coefficients; empty where the data alone decide.
        of_accelerations: Measured accelerations make its torque, and their noise.
        delays_torque: It delays the joint's torque; two such effects differ in the second order of their time only.
        shared_by_joints: One physical reason can give it to many joints at once: a delayed bus delays all commands.
        dry: Its torque depends on the sign of the speed.
        carried_by_robot: The maker may have told the robot of it: then the robot adds the torque that it takes to
            every command, and it shows at the link and once more in the drive.
        imitates_carried: A share of another joint's torque, which imitates something that the robot carries by
            numbers other than the real ones.
        first_excitation: Place in the list of effects that a first recording, without any suspicion, should tell
            apart on every joint; None for those that need a suspicion first.
        stated_outside: Id of the effect by which a patch states it where it is not of the robot (`is_outside`).
        exported: What it is in somebody's own simulator of rigid joints; empty where none has a number for it.
        not_exported: Why none has, at the ports where nothing is exported: the rest of a sentence on the effect.
        compensation: How a controller takes it back: a torque with a potential, of links (``weight``) or joints
            (``potential``); a torque along the desired motion, which the energy tank pays (``friction``); a command
            divided by its factor (``gain``). None where it cannot.
        compensated_at: Ports at which it can.
        not_compensated: Why it cannot at the others, and what can be done: the rest of a sentence on the effect.
    """

    description: Description
    shape: tuple[str, ...] = ()
    replaces: bool = False
    searched: Literal["always", "under_water", "in_contact", "while_held", "never"] = "always"
    nearly_linear: bool = False
    symmetric: bool = False
    contrasts: tuple[tuple[float, ...], ...] = ()
    bound_to_recording: bool = False
    in_every_drive: bool = False
    deviations: tuple[float, ...] = ()
    of_accelerations: bool = False
    delays_torque: bool = False
    shared_by_joints: bool = False
    dry: bool = False
    stated_outside: str | None = None
    carried_by_robot: bool = False
    imitates_carried: bool = False
    first_excitation: int | None = None
    exported: tuple[Exported, ...] = ()
    not_exported: str = (
        "its law is no number of a rigid joint or body; the simulation would have to compute it"
    )
    compensation: Compensation | None = None
    compensated_at: tuple[Port, ...] = ()
    not_compensated: str = "no torque is known that takes it back"

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

    def proportional_to_command(self, port: Port) -> bool:
        """Says whether its torque is in proportion to the torque or the motion that was asked for.

        A command knows the motion without the noise of its derivatives: such a column, beside an inertia's, can imitate
        that noise.
        """
        return False

    def encoder_side(self, port: Port) -> EncoderSide | None:
        """Side of the joint on which it has the encoder sit at this port; None where it says nothing of it."""
        return None

    def by_load(self, port: Port, shape: Mapping[str, float]) -> dict[str, float] | None:
        """Gives the shape in which what the motion needs stands in a command's place; None where nothing does."""
        return None

    def imitated_by(self, site: Site, values: Values) -> tuple[str, ...]:
        """Gives the ids of effects that would look the same as this one with its numbers in a recording."""
        return ()

    def computed_from_command(self, port: Port) -> bool:
        """Says whether its columns are made of what was asked for, which is known exactly as it was sent."""
        return False

    def periods(self, shape: Shape, travel: float) -> float:
        """Counts the periods of a periodic effect over a joint's travel [rad]; infinite for any other effect."""
        return float("inf")

    def joint_numbers(self, values: Values) -> dict[str, float]:
        """Gives the numbers of the nominal joint that it replaces; empty for an effect that adds to the model.

        Args:
            values: Its parameters.

        Returns:
            Some of ``reflected_inertia`` [kg.m^2], ``compliance`` [rad/(N.m)] and ``spring_damping`` [N.m.s/rad].
        """
        return {}

    def relations(self, values: Values) -> list[str]:
        """Lists violated relations between an effect's own numbers, in words."""
        return []

    def regressor(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Computes the columns in one residual; None where the effect cannot show or is not recorded."""
        if not self.shows(site.port, residual):
            return None
        found = self.in_residual(site, residual, shape)
        return None if found is None else self.felt(found, site, residual)

    def regressors(self, site: Site, residual: Residual, shapes: Sequence[Shape]) -> list[Regressor | None]:
        """Computes the columns of several shapes, one by one unless an effect can do better."""
        return [self.regressor(site, residual, shape) for shape in shapes]

    def felt(self, found: Regressor, site: Site, residual: Residual) -> Regressor:
        """What a torque costs where a residual measures it: one of the links goes through springs to the motors."""
        if not self.bends_springs(site.port) or not COVERS[residual] >= {"actuator", "link"}:
            return found
        whole = np.concatenate([found.columns, found.fixed[:, :, None]], axis=2)
        felt = site.signals.through_springs(whole, found.rows, of_accelerations=self.of_accelerations)
        return replace(found, columns=felt[:, :, :-1], fixed=felt[:, :, -1])

    def bends_springs(self, port: Port) -> bool:
        """Says whether its torque is the links': then the spring between motor and link carries it too."""
        return self.stage(port) == "link"

    @abstractmethod
    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Computes the columns in a residual in which it shows; None where what they need is not recorded."""

    def unresolved(self, shape: Shape, resolution: float) -> str | None:
        """Says why a shape cannot be seen through a position sensor's grid [rad]; None where it can."""
        return None

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Proposes the shapes to try; one empty shape for a linear effect."""
        return ({},)

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """Turns parameters into the regression's coefficients and the shape in which they are meant.

        Unless said otherwise the coefficients are the parameters outside the shape, zero where left out.
        """
        return self.linear(values)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Does the same where neither the nominal model nor the port matters."""
        coefficients = np.array([values.get(name, 0.0) for name in self.free])
        return coefficients, {name: values[name] for name in self.shape}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """Turns a regression's result into the effect's parameters."""
        found = dict(zip(self.free, map(float, coefficients), strict=True))
        return {
            name: found[name] if name in found else float(shape[name]) for name in self.description.symbols
        }

    def from_none(self, coefficients: Array, shape: Values) -> Array:
        """Gives a regression's result, counted from where there is no effect."""
        return coefficients

    @property
    def free(self) -> tuple[str, ...]:
        """Symbols that are coefficients of the regression."""
        return tuple(symbol for symbol in self.description.symbols if symbol not in self.shape)

    def next_shape(self, values: Values, shape: Mapping[str, float]) -> dict[str, float]:
        """Gives the shape for the next round of the regression; the same one when it has converged."""
        return {name: values.get(name, old) for name, old in shape.items()}

    def shapes_within_bounds(self, coefficients: Array) -> tuple[dict[str, float], ...]:
        """Shapes to try beside those of the grid where a fit's coefficients leave their bounds."""
        return ()

    def refined(self, shape: Shape) -> tuple[str, ...]:
        """Symbols of a shape that the regression moves off their grid: the law's, and how its sign changes."""
        return tuple(symbol for symbol in shape if symbol in (*self.shape, *REFINED))

    def nearest(self, symbol: str, value: float) -> float:
        """Gives the value within the physical bounds of a number that is nearest to one asked for."""
        if symbol in REFINED:
            return nearest_reversal(symbol, value)
        if symbol not in self.description.symbols:
            return value
        parameter = self.description.parameter(symbol)
        return min(max(value, parameter.lower), parameter.upper)

    def contradicted(self, values: Values, sites: Sequence[Site]) -> str | None:
        """Says why numbers cannot be, as recordings show at the candidate's place; None where they can."""
        return None

    def is_outside(self, shape: Shape, site: Site) -> bool:
        """Whether what was found in a recording is not of the robot, as that robot's maker would know it."""
        return False

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Returns the robot with the effect in its numbers: what both plant and model know."""
        return robot

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:  # noqa: B027
        """Tells the plant what reality does and the model does not know."""

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:  # noqa: B027
        """Tells the controller what takes the effect back, at a port of ``compensated_at``.

        Raises:
            BadInput: It cannot on this robot, or with these numbers.
        """


class JointLaw(Effect):
    """A torque that one joint consumes by a law of its own motion.

    The law is written once: plant and diagnosis both evaluate it. How the sign of dry friction changes at a reversal
    is no part of a ``dry`` law: the diagnosis tries a regularisation velocity and a short presliding displacement.

    Attributes:
        law: ``(sample, shape, columns)``, marked ``compiled``: writes what the consumed torque is linear in to
            ``columns[0]``, ``columns[1]`` and so on. ``sample`` has the fields of ``JointSample``, ``shape`` the values
            of ``shape``, in their order. The text has no branches: the plant runs it on numbers, the diagnosis on
            arrays over a recording. An effect that states ``basis`` instead needs none; the plant is slower then.
        terms: Number of columns that ``law`` writes.
        lower, upper: Physical bounds of the coefficients.
    """

    law: ClassVar[Law[..., None] | None] = None
    terms: ClassVar[int] = 1
    lower: Bound = 0.0
    upper: Bound = np.inf

    def __init_subclass__(cls) -> None:
        if cls.law is None and cls.basis is JointLaw.basis:
            raise TypeError(f"{cls.__qualname__} has no law (valid: a compiled 'law', or a method 'basis')")

    def basis(self, sample: JointSample, shape: Shape) -> Array:
        """Computes what the consumed torque is linear in, (..., p); unless said otherwise by ``law``.

        Shapes of several values, (S, 1), are evaluated together over a recording (N,), to (S, N, p).
        """
        numbers = [shape[name] for name in self.shape]
        columns = np.empty((self.terms, *np.broadcast_shapes(sample.velocity.shape, *map(np.shape, numbers))))
        if self.law is not None:
            self.law.python(sample, numbers, columns)
        return np.moveaxis(columns, 0, -1)

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Evaluates the law over a recording."""
        sample = as_it_reverses(site.sample(), site, shape)
        return one_row(site.joint, self.basis(sample, shape), lower=self.lower, upper=self.upper)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """One empty shape; for a dry law all ways in which its sign may change."""
        return self.with_reversal_shapes(site, ({},))

    def with_reversal_shapes(
        self, site: Site, shapes: tuple[dict[str, float], ...]
    ) -> tuple[dict[str, float], ...]:
        """Adds to the shapes of a dry law how its sign may change at reversals."""
        if not self.dry:
            return shapes
        return with_reversal_shapes(shapes, site, one_number=len(self.description.symbols) == 1)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Puts the same law on the plant's joints, as a torque against the motion."""
        pieces = [self.linear(values) for values in parameters.values()]
        shape = {name: np.array([own[name] for _, own in pieces]) for name in self.shape}
        coefficients = np.array([coefficient for coefficient, _ in pieces])
        text = self.law if type(self).basis is JointLaw.basis else None
        builder.add_law(
            self.basis, port, tuple(parameters), coefficients=coefficients, shape=shape, text=text
        )

    def least(self, numbers: IdentifiedNumbers) -> Values:
        """Gives the parameters of the least friction that the intervals allow: lower ends, never below zero."""
        return {
            symbol: number.value if symbol in self.shape else max(0.0, number.low)
            for symbol, number in numbers.items()
        }

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Overcomes the least friction that the intervals allow, by the same law."""
        for joint, numbers in found.numbers.items():
            coefficients, shape = self.linear(self.least(numbers))

            def law(sample: JointSample, c: Array = coefficients, shape: Shape = shape) -> Array:
                return np.asarray(self.basis(sample, shape) @ c)

            builder.add_friction(joint, law, found.speeds.get(joint))


class Stepped(Effect):
    r"""An effect all of whose numbers enter nonlinearly: the regression finds the step from a guess.

    p = p_0 + \delta p,      r = fixed(p_0) + columns(p_0) \delta p

    Attributes:
        starts: Guesses of an effect of one number, each of which is tried.
    """

    starts: tuple[float, ...] = ()

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts at each guess."""
        return tuple({self.shape[0]: start} for start in self.starts)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The shape says it all."""
        return np.zeros(len(self.shape)), {name: values[name] for name in self.shape}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The shape plus the step."""
        return dict(zip(self.shape, map(float, self.from_none(coefficients, shape)), strict=True))

    def from_none(self, coefficients: Array, shape: Values) -> Array:
        """The shape plus the step."""
        return np.array([shape[name] for name in self.shape]) + coefficients


def predicted(effect: Effect, site: Site, residual: Residual, values: Values) -> Array:
    """Computes what an effect with known parameters adds to a residual, (N, n); zero where it does not show."""
    total = np.zeros((site.signals.samples, site.signals.n))
    coefficients, shape = effect.coefficients(values, site)
    found = effect.regressor(site, residual, shape)
    if found is not None:
        total[:, list(found.rows)] += found.torque(coefficients)
    return total
