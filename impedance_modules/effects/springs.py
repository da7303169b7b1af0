# SPDX-License-Identifier: BSD-3-Clause
"""Torques that depend on where the joint stands: springs beside it, and ripple from teeth and magnets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.compensation_builder import CompensationBuilder, Diagnosed
from impedance_modules.effects.effect import JointLaw, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port, joint_parameter
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, one_row
from impedance_modules.effects.residual_kinds import COVERS, Residual
from impedance_modules.effects.simulator_numbers import Exported
from impedance_modules.errors import BadInput
from impedance_modules.records import Matrix, Row, Vector
from impedance_modules.spec.robot_spec import ParallelSpringSpec, RobotSpec

CARRIED = "carried"
"""Shape: the robot knows the spring and adds the torque that deflects it to what carries its weight; else missing."""

OUTSIDE = "bench_spring"
"""Effect by which a patch says that the robot does not carry a spring."""

MOST_ORDERS = 400
"""Largest number of ripple orders tried."""


@compiled
def joint_spring(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001 - every law has these
    """Writes q and -1."""
    columns[0] = sample.position
    columns[1] = -1.0


@compiled
def ripple(sample: Row, shape: Vector, columns: Matrix) -> None:
    """Writes sin(N q) and cos(N q)."""
    turned = sample.position * shape[0]
    columns[0] = np.sin(turned)
    columns[1] = np.cos(turned)


@compiled
def damped_spring(sample: Row, shape: Vector, columns: Matrix) -> None:  # noqa: ARG001
    """Writes q, -1 and v."""
    columns[0] = sample.position
    columns[1] = -1.0
    columns[2] = sample.velocity


class ParallelSpring(JointLaw):
    """k (q - q0); where the robot carries it, the drive gives as much more than was asked for."""

    description = Description(
        id="parallel_spring",
        sentence="A spring beside the joint's drive: it carries weight, or it is a bundle of cables that bends.",
        equation="tau = k (q - q0) = k q - preload; the spring's own torque on the joint is -k (q - q0)",
        parameters=(
            joint_parameter("k", "N.m/rad", "stiffness", lower=0.0),
            joint_parameter("q0", "rad", "angle at which it is relaxed", left_out="preload is given instead"),
            joint_parameter(
                "preload", "N.m", "its torque on the joint at q = 0, k q0", left_out="q0 is given instead"
            ),
        ),
        ports=("link",),
        signature="linear in the joint's angle, at rest too",
        confusable_with=("reflected_inertia", "payload", "torque_offset", "base_tilt"),
        excitation="a grid of static poses; a single tone cannot tell it from inertia",
        reference="thesis 2.1 (shoulder springs)",
        applied="Plant and model. A robot that carries its own weight carries its springs too (design 4).",
    )
    carried_by_robot = True
    stated_outside = OUTSIDE
    compensation = "potential"
    compensated_at = ("link",)
    exported = (
        Exported("joint spring", "k, preload (or k q0)", lambda values: (values["k"], preload_of(values))),
    )
    first_excitation = 4
    lower = (0.0, -np.inf)
    contrasts = ((1.0, 0.0),)

    law = joint_spring
    terms = 2

    def regressor(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Evaluates the law; a carried spring is consumed at the link and supplied, unasked, by the drive."""
        supplied = float(CARRIED in shape and "drive" in COVERS[residual])
        sign = float(self.shows(site.port, residual)) - supplied
        if sign == 0.0:
            return None
        columns = sign * self.basis(site.sample(), shape)
        return one_row(site.joint, columns, lower=self.lower)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Unknown to the robot; or known, where it adds torques of its own and both ends of the joint are seen."""
        if site.signals.assistance is None or site.signals.effort is None:
            return ({},)
        return ({}, {CARRIED: 1.0})

    def is_outside(self, shape: Shape, site: Site) -> bool:
        """A robot that adds torques of its own would carry its springs, and did not."""
        return site.signals.assistance is not None and CARRIED not in shape

    def coefficients(self, values: Values, site: Site) -> tuple[Array, dict[str, float]]:
        """The recording tells whether the robot carries it: more effort than asked for, by what deflects it."""
        signals = site.signals
        coefficients, shape = self.linear(values)
        asked, measured = signals.drive, signals.effort
        if signals.assistance is None or asked is None or measured is None:
            return coefficients, shape
        deflecting = self.basis(site.sample(), shape) @ coefficients
        unasked = (measured - asked)[:, site.joint]
        carried = float(unasked @ deflecting) > 0.5 * float(deflecting @ deflecting)
        return coefficients, {CARRIED: 1.0} if carried else shape

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients k and preload."""
        return np.array([values["k"], preload_of(values)]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The coefficients are k and preload."""
        return {"k": float(coefficients[0]), "preload": float(coefficients[1])}

    def relations(self, values: Values) -> list[str]:
        """Exactly one of q0 and preload says where it is relaxed."""
        given = [symbol for symbol in ("q0", "preload") if symbol in values]
        return [] if len(given) == 1 else ["needs exactly one of q0 and preload"]

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Tells the model, whose joints carry the spring."""
        springs = dict(robot.parallel_springs)
        for joint, values in parameters.items():
            before = springs.get(joint, ParallelSpringSpec(0.0, 0.0))
            springs[joint] = ParallelSpringSpec(
                before.stiffness + values["k"], before.preload + preload_of(values)
            )
        return replace(robot, parallel_springs=springs)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Puts the spring on the links and tells the robot, whose maker knows it."""
        super().apply_to_plant(builder, port, parameters)
        joints = builder.joints(parameters)
        builder.spring_stiffness[joints] += [values["k"] for values in parameters.values()]
        builder.spring_preload[joints] += [preload_of(values) for values in parameters.values()]

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Winds the springs, unless the robot does."""
        if builder.model.spec.gravity_compensation == "robot":
            raise BadInput(
                "robot '"
                + builder.model.spec.name
                + "' carries its own weight, and its parallel springs with it: a"
                f" second torque would wind them twice (valid: a spring that the robot does not carry, as {OUTSIDE})"
            )
        for joint, numbers in found.numbers.items():
            values = {symbol: number.value for symbol, number in numbers.items()}
            builder.add_potential(joint, -preload_of(values), values["k"])


def preload_of(values: Values) -> float:
    """Gives a parallel spring's torque on its joint at q = 0 [N.m]."""
    return values["preload"] if "preload" in values else values["k"] * values["q0"]


class TorqueRipple(JointLaw):
    """A sin(N q + phi)."""

    description = Description(
        id="torque_ripple",
        sentence="Magnets cog and teeth mesh: a torque that repeats N times per turn of the joint.",
        equation="tau = A sin(N q + phi)",
        parameters=(
            joint_parameter("A", "N.m", "amplitude", lower=0.0),
            Parameter(
                "N", "1", "periods per turn (per 2 pi m for a sliding joint)", lower=0.0, positive=True
            ),
            Parameter("phi", "rad", "phase at q = 0", left_out="0"),
        ),
        signature="a line in the spectrum over position, at the same place for every speed",
        confusable_with=("parallel_spring",),
        excitation="slow sweeps over the whole range, both ways",
        reference="Ghorbel, Gandhi & Alpeter 2001 (harmonic drives)",
    )
    shape = ("N",)
    not_compensated = (
        "it repeats so often per turn that a torque which is late, or meets an angle that is a little off, adds to it"
        " instead (valid: slower motion, or a stiffer joint)"
    )
    not_exported = "a joint there has no torque that repeats with its angle"
    lower = -np.inf  # any phase

    law = ripple
    terms = 2

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients A cos(phi) and A sin(phi)."""
        phase = values.get("phi", 0.0)
        return values["A"] * np.array([np.cos(phase), np.sin(phase)]), {"N": values["N"]}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """Amplitude and phase of the two."""
        across, along = map(float, coefficients)
        return {
            "A": float(np.hypot(across, along)),
            "N": float(shape["N"]),
            "phi": float(np.arctan2(along, across)),
        }

    def periods(self, shape: Shape, travel: float) -> float:
        """N q / (2 pi) over the travel."""
        return float(np.max(shape["N"])) * travel / (2.0 * np.pi)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Tries orders as finely as the joint's travel can tell apart, up to what the sampling can follow."""
        position = site.signals.position[:, site.joint]
        jump = float(np.abs(np.diff(position)).max())
        if site.travel < 1e-3 or jump == 0.0:
            return ()
        # At most 1 rad out of phase at either end: some steps of Newton mend that.
        spacing = 4.0 / site.travel
        orders = np.arange(0.75 * spacing, np.pi / jump, spacing)[:MOST_ORDERS]
        return tuple({"N": float(order)} for order in orders)

    def regressors(self, site: Site, residual: Residual, shapes: Sequence[Shape]) -> list[Regressor | None]:
        """Evaluates all orders together: there are hundreds."""
        if not shapes or not self.shows(site.port, residual):
            return [None] * len(shapes)
        orders = np.array([[shape["N"]] for shape in shapes])
        return [
            self.felt(one_row(site.joint, columns, lower=self.lower), site, residual)
            for columns in self.basis(site.sample(), {"N": orders})
        ]


class BenchSpring(JointLaw):
    """k (q - q0) + d v."""

    description = Description(
        id="bench_spring",
        sentence="A damped spring between a link and the bench: a torsion spring, or a clamp if it is stiff.",
        equation="tau = k (q - q0) + d v; the spring's own torque on the joint is -k (q - q0) - d v",
        parameters=(
            joint_parameter("k", "N.m/rad", "stiffness", lower=0.0),
            joint_parameter("q0", "rad", "angle at which it is relaxed"),
            joint_parameter("d", "N.m.s/rad", "its damping", lower=0.0, left_out="0"),
        ),
        ports=("contact",),
        signature="linear in the joint's angle, at rest too",
        confusable_with=("parallel_spring", "payload", "torque_offset", "viscous_friction"),
        excitation="a grid of static poses; a single tone cannot tell it from inertia",
        reference="thesis 3.2.1 (figure 3-6)",
        applied="The plant, as a torque on the link; neither the model nor what the robot adds by itself knows it.",
    )
    lower = (0.0, -np.inf, 0.0)
    compensation = "potential"
    compensated_at = ("contact",)
    exported = (
        Exported("joint spring", "k, k q0", lambda values: (values["k"], values["k"] * values["q0"])),
        Exported("viscous friction", "D = d", lambda values: (values["d"],) if "d" in values else ()),
    )
    searched = "never"  # without a patch it is named a parallel spring: at the links the two are one law

    law = damped_spring
    terms = 3

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients k, k q0 and d."""
        return np.array([values["k"], values["k"] * values["q0"], values.get("d", 0.0)]), {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The inverse of ``linear``; a spring without stiffness is relaxed anywhere, q0 = 0."""
        k, preload, d = map(float, coefficients)
        return {"k": k, "q0": preload / k if k > 0.0 else 0.0, "d": d}

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Winds the springs; their damping is left to them."""
        for joint, numbers in found.numbers.items():
            k, q0 = numbers["k"].value, numbers["q0"].value
            builder.add_potential(joint, -k * q0, k)
