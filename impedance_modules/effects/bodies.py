# SPDX-License-Identifier: BSD-3-Clause
"""Payload, errors of a link's inertia, and base tilt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect import Effect, Regressor, Stepped, Values, all_rows, unbounded
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.residual_kinds import Residual, uses_motion
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import BodyChange, RobotSpec

Array = NDArray[np.float64]

CENTRE = ("cx", "cy", "cz")

FAR = 3.0
"""Distance from a link's origin beyond which nothing is fixed to it [m]: a moment without a mass, not a thing."""

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


class Payload(Effect):
    """A small heavy thing fixed to a link."""

    description = Description(
        id="payload",
        sentence="Something is fixed to a link that the model does not know: a tool, a gripper, a thing in the hand.",
        equation="tau = Y(q, v, a) pi, pi of a point mass m at (cx, cy, cz) in the link's frame",
        parameters=(
            Parameter("m", "kg", "mass", lower=0.0),
            *(Parameter(name, "m", f"its place along the link's {name[1]} axis") for name in CENTRE),
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

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Columns of m and of the first moments m c; the inertia is that of m at the present guess of c."""
        if not uses_motion(residual):
            return None
        whole = signals.body_columns(key)
        guess = point_mass(1.0, np.array([float(shape[name]) for name in CENTRE]))
        heavy = whole[:, :, 0] + whole[:, :, 4:] @ guess[4:]
        columns = np.concatenate([heavy[:, :, None], whole[:, :, 1:4]], axis=2)
        return all_rows(signals, columns, np.array([0.0, -np.inf, -np.inf, -np.inf]), np.full(4, np.inf))

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Starts at the link's origin, at its centre of mass, and as far beyond: where things are fixed."""
        body = signals.model.body_inertia(key)
        centre = body[1:4] / body[0] if body[0] > 0.0 else np.zeros(3)
        starts = [reach * centre for reach in (0.0, 1.0, 2.0)][: 3 if centre.any() else 1]
        return tuple(dict(zip(CENTRE, map(float, start), strict=True)) for start in starts)

    def coefficients(
        self, values: Values, signals: Signals, key: str, port: Port
    ) -> tuple[Array, dict[str, float]]:
        """Coefficients m and m c."""
        centre = {name: values[name] for name in CENTRE}
        return values["m"] * np.array([1.0, *centre.values()]), centre

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """C = (m c) / m; without mass there is no place."""
        m = float(coefficients[0])
        centre = coefficients[1:] / m if m > 0.0 else np.zeros(3)
        return {"m": m, **dict(zip(CENTRE, map(float, centre), strict=True))}

    def out_of_reach(self, coefficients: Array, spread: Array, reach: float) -> str | None:
        """First moments need a mass near enough: |m c| <= m reach."""
        mass = max(float(coefficients[0]), 0.0) + float(spread[0])
        moment = float(np.linalg.norm(coefficients[1:]))
        return (
            None if moment <= mass * reach else "its first moments need more mass than there is within reach"
        )

    def relations(self, values: Values) -> list[str]:
        """A thing is fixed where the link is, not where only its lever could be."""
        far = float(np.linalg.norm([values[name] for name in CENTRE]))
        return [f"its place is {far:.3g} m from the link's origin (valid: {FAR:g} m)"] if far > FAR else []

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Adds point masses to links."""
        changes = [
            BodyChange(link, tuple(point_mass(v["m"], np.array([v[name] for name in CENTRE]))))
            for link, v in parameters.items()
        ]
        return replace(robot, body_changes=(*robot.body_changes, *changes))


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

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """Ten columns, or what a link costs that is heavier all over, per kilogram."""
        if not uses_motion(residual):
            return None
        whole = signals.body_columns(key)
        if not shape.get(ALL_OVER):
            return all_rows(signals, whole, *unbounded(10))
        nominal = _heavier(signals, key, shape)
        column = whole @ (nominal / nominal[0])
        return all_rows(signals, column[:, :, None], np.array([-nominal[0]]), np.full(1, np.inf))

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
        """Any change; one that leaves the centre of the link with all that is fixed to it; one that leaves its own."""
        whole, own = signals.model.body_inertia(key), signals.model.link_inertia(key)
        kinds = [0.0, *([WITH_FIXED] if whole[0] > 0.0 else [])]
        if own[0] > 0.0 and not np.allclose(own, whole):
            kinds.append(ALONE)
        return tuple({ALL_OVER: kind} for kind in kinds)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The ten changes."""
        return np.array([values.get(symbol, 0.0) for symbol in CHANGES]), {ALL_OVER: 0.0}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The coefficients, or the nominal link's parameters in proportion to its mass."""
        if shape.get(ALL_OVER):
            nominal = _heavier(signals, key, shape)
            coefficients = float(coefficients[0]) * nominal / nominal[0]
        return dict(zip(CHANGES, map(float, coefficients), strict=True))

    def relations(self, values: Values) -> list[str]:
        """At least one number must be given."""
        return [] if values else [f"gives none of its numbers ({', '.join(CHANGES)})"]

    def apply_to_robot(self, robot: RobotSpec, port: Port, parameters: Mapping[str, Values]) -> RobotSpec:
        """Changes links."""
        changes = [
            BodyChange(link, tuple(float(values.get(symbol, 0.0)) for symbol in CHANGES))
            for link, values in parameters.items()
        ]
        return replace(robot, body_changes=(*robot.body_changes, *changes))


def _heavier(signals: Signals, key: str, shape: Shape) -> Array:
    """Parameters (10,) of what is heavier in proportion: a link alone, or with all that is fixed to it."""
    model = signals.model
    return model.link_inertia(key) if shape[ALL_OVER] == ALONE else model.body_inertia(key)


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
        keys=("base",),
        signature="like weight on all joints, by two numbers that they share",
        confusable_with=("torque_offset", "encoder_offset", "payload"),
        excitation="poses all around, the first joint included",
        reference="Newton's law of weight, in turned axes",
        applied="Plant and model: gravity. The robot's own gravity compensation does not know it.",
    )
    shape = ("rx", "ry")

    def regressor(
        self, signals: Signals, key: str, port: Port, residual: Residual, shape: Shape
    ) -> Regressor | None:
        """The weight's change at the guessed lean, and its slope by the lean."""
        if not uses_motion(residual):
            return None
        lean = np.array([float(shape["rx"]), float(shape["ry"])])
        here = _leaning(signals.model.gravity, lean)
        slopes = [
            (_leaning(signals.model.gravity, lean + step) - here) / SMALL_LEAN
            for step in SMALL_LEAN * np.eye(2)
        ]
        columns = np.stack([signals.weight_columns @ slope for slope in slopes], axis=2)
        fixed = signals.weight_columns @ (here - signals.model.gravity)
        return Regressor(tuple(range(signals.n)), columns, fixed, -0.6 - lean, 0.6 - lean)

    def shapes(self, signals: Signals, key: str, port: Port) -> tuple[dict[str, float], ...]:
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
