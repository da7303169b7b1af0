# SPDX-License-Identifier: BSD-3-Clause
"""Payload, errors of a link's inertia, and base tilt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.compensation_builder import CompensationBuilder, Diagnosed
from impedance_modules.effects.effect import Effect, Stepped, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.simulator_numbers import Exported
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import BodyChange, RobotSpec

CENTRE = ("cx", "cy", "cz")

DISTANCES = (0.03, 0.1, 0.3)
"""Of a mass from its link's origin, at which it is looked for where only its moments are known [m]."""

FAR = 3.0
"""Distance from a link's origin beyond which nothing is fixed to it [m]: a moment without a mass, not a thing."""

HEAVY = 1000.0
"""Standard deviation of a payload's mass, and of its first moments, before anything was recorded [kg, kg.m]: the
largest arms carry 2300 kg. Where weight and inertia hardly differ, two numbers of a million cancel without it."""

MOMENTS = ("dhx", "dhy", "dhz")

INERTIAS = ("dIxx", "dIxy", "dIyy", "dIxz", "dIyz", "dIzz")

CHANGES = ("dm", *MOMENTS, *INERTIAS)

ALL_OVER = "all_over"
"""Shape: not zero where the link is heavier or lighter all over, its centre and radii of gyration as believed ..."""

WITH_FIXED, ALONE = 1.0, 2.0
"""... together with all that is fixed to it, or by itself: a wrist without its hand."""

SMALL_LEAN = 1e-6
"""Step of the derivative by the lean [rad]."""


def point_mass(mass: float, centre: Array) -> Array:
    """Ten inertial parameters of a point mass at a point of the body's frame, about the frame's origin."""
    x, y, z = centre
    around = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    return np.concatenate([[mass], mass * centre, mass * around])


def inertia_slopes(centre: Array) -> Array:
    """Derivatives (6, 3) of a point mass's inertia by its first moments h = m c, its mass kept [m]."""
    x, y, z = centre
    by_x = (0.0, -y, 2.0 * x, -z, 0.0, 2.0 * x)
    by_y = (2.0 * y, -x, 0.0, 0.0, -z, 2.0 * y)
    by_z = (2.0 * z, 0.0, 2.0 * z, -x, -y, 0.0)
    return np.array([by_x, by_y, by_z]).T


def place_on_link(meaning: str) -> tuple[Parameter, ...]:
    """Describes the three coordinates of a point of a link."""
    return tuple(Parameter(name, "m", f"{meaning} along the link's {name[1]} axis") for name in CENTRE)


def centre_of(values: Shape) -> Array:
    """Gives the point (3,) of a link at which an effect acts, from its parameters or its shape."""
    return np.array([float(values[name]) for name in CENTRE])


def by_axis(centre: Array) -> dict[str, float]:
    """Names the coordinates of a point of a link."""
    return dict(zip(CENTRE, map(float, centre), strict=True))


class MassAtPoint(Effect):
    """A mass m at a point c of a link, whose weight is linear in m and in m c; the regression's coefficients."""

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients m and m c; where the point is part of the shape, it starts at the values' own."""
        centre = centre_of(values)
        return values["m"] * np.array([1.0, *centre]), by_axis(centre) if self.shape else {}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """C = (m c) / m; without mass there is no place."""
        m = float(coefficients[0])
        return {"m": m, **by_axis(coefficients[1:] / m if m > 0.0 else np.zeros(3))}

    def of_moments(self, columns: Array) -> Regressor:
        """Makes a regressor of the columns (N, n, 4) of m and m c."""
        return all_rows(columns, lower=(0.0, -np.inf, -np.inf, -np.inf))


class Payload(MassAtPoint):
    """A small heavy thing fixed to a link."""

    description = Description(
        id="payload",
        sentence="Something is fixed to a link that the model does not know: a tool, a gripper, a thing in the hand.",
        equation="tau = Y(q, v, a) pi, pi of a point mass m at (cx, cy, cz) in the link's frame",
        parameters=(
            Parameter("m", "kg", "mass", lower=0.0),
            *place_on_link("its place"),
        ),
        ports=("link",),
        keys=("body",),
        signature="weight and inertia on all joints before the link, in fixed proportions",
        confusable_with=("link_inertia", "torque_gain", "base_tilt", "encoder_offset"),
        excitation="static poses and rich motion of several joints",
        reference="Gautier & Khalil 1990; Swevers et al. 2002",
        applied="Plant and model: the link's inertia. The robot's own gravity compensation does not know it.",
    )
    shape = CENTRE
    deviations = (HEAVY,) * 4
    of_accelerations = True
    compensation = "weight"
    compensated_at = ("link",)
    exported = (
        Exported(
            "body inertia",
            "m, m c, inertia m (c.c 1 - c c^T)",
            lambda values: point_mass(values["m"], centre_of(values)),
        ),
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Columns of M and of the first moments h = m c, the inertia linearised about the present guess c_0 of c.

            h^2 / m  ~  2 c_0 h - c_0^2 m  =  c_0^2 M        (in three dimensions likewise, see `inertia_slopes`)

        A joint that swings shows h and the inertia, and no mass: then M is right whatever the guess, and m = h^2 over
        that inertia. Where the weight shows the mass, one guess only fits both.
        """
        whole, guess = site.signals.body_columns(site.key), centre_of(shape)
        weight, moments, inertia = whole[:, :, 0], whole[:, :, 1:4], whole[:, :, 4:]
        square = float(guess @ guess)
        if square > 0.0:
            light = inertia @ point_mass(1.0, guess)[4:] - weight
            lean = inertia @ inertia_slopes(guess) - light[:, :, None] * (2.0 * guess / square)
            weight, moments = light, moments + lean
        return self.of_moments(np.concatenate([weight[:, :, None], moments], axis=2))

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The point mass with these first moments and this inertia; about the origin, where there is none, with M."""
        moments, square = coefficients[1:], float(np.sum(centre_of(shape) ** 2))
        inertia, moment_square = float(coefficients[0]) * square, float(moments @ moments)
        if inertia <= 0.0 or moment_square == 0.0:
            return super().values(coefficients, shape, site)
        mass = moment_square / inertia
        return {"m": mass, **by_axis(moments / mass)}

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts at the link's origin, at its centre of mass, and as far beyond: where things are fixed."""
        body = site.signals.model.body_inertia(site.key)
        centre = body[1:4] / body[0] if body[0] > 0.0 else np.zeros(3)
        starts = [reach * centre for reach in (0.0, 1.0, 2.0)][: 3 if centre.any() else 1]
        return tuple(by_axis(start) for start in starts)

    def shapes_within_bounds(self, coefficients: Array) -> tuple[dict[str, float], ...]:
        """Places along the first moments: where a fit asks for a mass below zero, they are known and it is not.

        The weight hardly shows the mass of what is at an arm's end, since any link before it may be as much heavier.
        """
        moments = coefficients[1:]
        size = float(np.linalg.norm(moments))
        return tuple(by_axis(distance / size * moments) for distance in DISTANCES if size > 0.0)

    def relations(self, values: Values) -> list[str]:
        """A thing is fixed where the link is, not where only its lever could be."""
        far = float(np.linalg.norm(centre_of(values)))
        return [f"its place is {far:.3g} m from the link's origin (valid: {FAR:g} m)"] if far > FAR else []

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Adds point masses to links."""
        masses = {link: point_mass(values["m"], centre_of(values)) for link, values in parameters.items()}
        return _with_changes(robot, masses)

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Holds the point masses' weight; where there is no mass, no number of the robot is touched."""
        values = {link: numbers for link, numbers in values_of(found).items() if numbers["m"] > 0.0}
        builder.change_weight(lambda robot: self.apply_to_robot(robot, "link", values))


class LinkInertia(Effect):
    """A link whose ten inertial parameters are not those of the model."""

    description = Description(
        id="link_inertia",
        sentence="A link's mass, centre of mass or inertia is not what the robot description says.",
        equation="tau = Y(q, v, a) dpi, dpi = (dm, dh, dI) in the link's frame, inertia about its origin, h = m c",
        parameters=(
            Parameter("dm", "kg", "mass beyond the model's", left_out="as in the model"),
            *(
                Parameter(s, "kg.m", f"first moment beyond the model's, {s[-1]}", left_out="as in the model")
                for s in MOMENTS
            ),
            *(
                Parameter(s, "kg.m^2", f"inertia beyond the model's, {s[-2:]}", left_out="as in the model")
                for s in INERTIAS
            ),
        ),
        ports=("link",),
        keys=("body",),
        signature="weight and inertia on all joints before the link, in fixed proportions",
        confusable_with=("payload", "torque_gain", "reflected_inertia"),
        excitation="static poses and rich motion; only base combinations can be found",
        reference="Gautier & Khalil 1990; Wensing, Kim & Slotine 2018",
        applied="Plant and model: the link's inertia, refused if what results is no physical body.",
    )
    of_accelerations = True
    compensation = "weight"
    compensated_at = ("link",)
    exported = (
        Exported(
            "body inertia", "dm, dh, dI", lambda values: [values.get(symbol, 0.0) for symbol in CHANGES]
        ),
    )

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Ten columns, or what a link costs that is heavier all over, per kilogram."""
        signals = site.signals
        whole = signals.body_columns(site.key)
        if not shape.get(ALL_OVER):
            return all_rows(whole)
        nominal = _heavier(site, shape)
        column = whole @ (nominal / nominal[0])
        return all_rows(column[:, :, None], lower=-float(nominal[0]))

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Any change; one that leaves the centre of the link with all that is fixed to it; one that leaves its own."""
        model = site.signals.model
        whole, own = model.body_inertia(site.key), model.link_inertia(site.key)
        kinds = [0.0, *([WITH_FIXED] if whole[0] > 0.0 else [])]
        if own[0] > 0.0 and not np.allclose(own, whole):
            kinds.append(ALONE)
        return tuple({ALL_OVER: kind} for kind in kinds)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The ten changes."""
        return np.array([values.get(symbol, 0.0) for symbol in CHANGES]), {ALL_OVER: 0.0}

    def values(self, coefficients: Array, shape: Values, site: Site) -> dict[str, float]:
        """The coefficients, or the nominal link's parameters in proportion to its mass."""
        if shape.get(ALL_OVER):
            nominal = _heavier(site, shape)
            coefficients = float(coefficients[0]) * nominal / nominal[0]
        return dict(zip(CHANGES, map(float, coefficients), strict=True))

    def relations(self, values: Values) -> list[str]:
        """At least one number must be given."""
        return [] if values else [f"gives none of its numbers ({', '.join(CHANGES)})"]

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Changes links."""
        return _with_changes(robot, {link: self.linear(values)[0] for link, values in parameters.items()})

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Holds what the links weigh beyond their description; their inertia needs the acceleration."""
        builder.change_weight(lambda robot: self.apply_to_robot(robot, "link", values_of(found)))


def values_of(found: Diagnosed) -> dict[str, Values]:
    """Strips the standard deviations: key -> symbol -> value."""
    return {
        key: {symbol: number.value for symbol, number in numbers.items()}
        for key, numbers in found.numbers.items()
    }


def _with_changes(robot: RobotSpec, links: Mapping[str, Array]) -> RobotSpec:
    """Adds ten inertial parameters to each of some links."""
    changes = (BodyChange(link, tuple(map(float, change))) for link, change in links.items())
    return replace(robot, body_changes=(*robot.body_changes, *changes))


def _heavier(site: Site, shape: Shape) -> Array:
    """Parameters (10,) of what is heavier in proportion: a link alone, or with all that is fixed to it."""
    model = site.signals.model
    return model.link_inertia(site.key) if shape[ALL_OVER] == ALONE else model.body_inertia(site.key)


def _leaning(gravity: Array, lean: Array) -> Array:
    """Gives gravity (3,) in the axes of a base that leans about its x and y axes."""
    return np.asarray(exp3(np.array([*lean, 0.0])).T @ gravity)


class BaseTilt(Stepped):
    """A base that leans."""

    description = Description(
        id="base_tilt",
        sentence="The robot leans: gravity does not point down its own z axis, and every weight pulls askew.",
        equation="gravity in the base's axes = exp([rx, ry, 0])^T g; tau = (d weight / d gravity) (gravity - g)",
        parameters=(
            Parameter("rx", "rad", "lean about the base's x axis", lower=-0.6, upper=0.6),
            Parameter("ry", "rad", "lean about the base's y axis", lower=-0.6, upper=0.6),
        ),
        ports=("link",),
        places={"link": "base"},
        keys=("base",),
        signature="like weight on all joints, by two numbers that they share",
        confusable_with=("torque_offset", "encoder_offset", "payload"),
        excitation="poses all around, the first joint included",
        reference="Newton's law of weight, in turned axes",
        applied="Plant and model: gravity. The robot's own gravity compensation does not know it.",
    )
    shape = ("rx", "ry")
    compensation = "weight"
    compensated_at = ("link",)
    exported = (Exported("base lean", "r = (rx, ry, 0)", lambda values: (values["rx"], values["ry"])),)

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """The weight's change at the guessed lean, and its slope by the lean."""
        signals = site.signals
        lean = np.array([float(shape["rx"]), float(shape["ry"])])
        here = _leaning(signals.model.gravity, lean)
        slopes = [
            (_leaning(signals.model.gravity, lean + step) - here) / SMALL_LEAN
            for step in SMALL_LEAN * np.eye(2)
        ]
        columns = np.stack([signals.weight_columns @ slope for slope in slopes], axis=2)
        fixed = signals.weight_columns @ (here - signals.model.gravity)
        return all_rows(columns, fixed, -0.6 - lean, 0.6 - lean)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Starts upright."""
        return ({"rx": 0.0, "ry": 0.0},)

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Turns gravity."""
        for values in parameters.values():
            x, y, z = _leaning(np.array(robot.gravity), np.array([values["rx"], values["ry"]]))
            robot = replace(robot, gravity=(float(x), float(y), float(z)))
        return robot

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Turns the plant's gravity too."""
        for values in parameters.values():
            builder.tilt += [values["rx"], values["ry"]]

    def compensate(self, builder: CompensationBuilder, found: Diagnosed) -> None:
        """Holds what all links weigh askew."""
        builder.change_weight(lambda robot: self.apply_to_robot(robot, "link", values_of(found)))
