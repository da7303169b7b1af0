# SPDX-License-Identifier: BSD-3-Clause
"""Checks the meaning of a patch, beyond its schema; reports every problem at its place in the file."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect import Effect
from impedance_modules.effects.effect_description import Description, KeyKind, Parameter, same_unit
from impedance_modules.effects.regressor import PAIR
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.effects.surface_effects import surface_index
from impedance_modules.errors import Problem, nearest
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, PatchSpec
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.urdf import UrdfFacts

KIND_IN_WORDS: dict[KeyKind, str] = {
    "joint": "a joint",
    "pair": "JOINT<-OTHER",
    "body": "a link that moves",
    "base": "'base'",
    "log": "'log'",
    "surface": "a surface of the task, 'surface0' its first",
    "object": "'object', which the task's hands hold",
}


@dataclass(frozen=True)
class PatchTarget:
    """What a patch names parts of: a robot folder, or somebody's own description of a robot.

    Attributes:
        words: What messages call it.
        joints: Names of its joints with one axis.
        sliding: Those that slide instead of turning.
        bodies: Names of its links that a patch may change.
        motor_damping: Joint -> its own viscous friction at the motor [N.m.s/rad], infinite where nobody knows it.
    """

    words: str
    joints: tuple[str, ...]
    sliding: Collection[str]
    bodies: tuple[str, ...]
    motor_damping: Mapping[str, float]

    @classmethod
    def of_robot(cls, robot: RobotSpec) -> PatchTarget:
        """Takes a robot folder; its links are those that joints move."""
        model = RigidModel.of_robot(RobotModel(robot))
        return cls(
            words=f"robot '{robot.name}'",
            joints=tuple(robot.joints),
            sliding=frozenset(np.array(model.joint_names)[model.sliding].tolist()),
            bodies=model.bodies,
            motor_damping={name: joint.motor_damping for name, joint in robot.joints.items()},
        )

    @classmethod
    def of_urdf(cls, path: Path, facts: UrdfFacts) -> PatchTarget:
        """Takes what was read of a URDF, or of what was made one; ``path`` is the file that the user gave."""
        joints = tuple(name for name, joint in facts.joints.items() if joint.has_one_axis)
        return cls(
            words=str(path),
            joints=joints,
            sliding=frozenset(name for name in joints if facts.joints[name].type == "prismatic"),
            bodies=facts.links,
            motor_damping=dict.fromkeys(joints, np.inf),
        )


@dataclass
class _Check:
    """One effect of a patch, with what is needed to judge it."""

    patch: PatchSpec
    target: PatchTarget
    index: int

    @cached_property
    def spec(self) -> EffectSpec:
        return self.patch.effects[self.index]

    @property
    def effect(self) -> Effect:
        return CATALOGUE[self.spec.effect]

    @property
    def description(self) -> Description:
        return self.effect.description

    def slides(self, key: str) -> bool:
        """Says whether a key names a joint that slides instead of turning."""
        return key.partition(PAIR)[0] in self.target.sliding

    def problem(
        self, *inside: str | int, message: str, valid: tuple[str, ...] = (), at: str = "value"
    ) -> Problem:
        return self.patch.document.problem(("effects", self.index, *inside), message, valid, at)


def patch_problems(patch: PatchSpec, robot: RobotSpec) -> list[Problem]:
    """Lists everything in a patch that does not fit the catalogue or the robot."""
    if patch.robot != robot.name:
        message = f"the patch is for robot '{patch.robot}', not for '{robot.name}'"
        return [patch.document.problem(("robot",), message)]
    return target_problems(patch, PatchTarget.of_robot(robot))


def target_problems(patch: PatchSpec, target: PatchTarget) -> list[Problem]:
    """Lists everything in a patch that does not fit the catalogue or what it shall be applied to."""
    checks = [_Check(patch, target, index) for index in range(len(patch.effects))]
    found: list[Problem] = []
    for check in checks:
        found.extend(_effect_problems(check))
    found.extend(_repeat_problems(checks))
    return found or list(_one_way_problems(checks))


def _effect_problems(check: _Check) -> Iterator[Problem]:
    spec = check.spec
    if spec.effect not in CATALOGUE:
        message = f"this version has no effect '{spec.effect}'{nearest(spec.effect, tuple(CATALOGUE))}"
        yield check.problem("effect", message=message, valid=tuple(CATALOGUE))
        return
    if spec.port not in check.description.ports:
        message = f"{spec.effect} does not act at port '{spec.port}'"
        yield check.problem("port", message=message, valid=check.description.ports)
    yield from _joint_problems(check)
    for key in spec.parameters:
        yield from _key_problems(check, key)
        yield from _number_problems(check, key)


def _joint_problems(check: _Check) -> Iterator[Problem]:
    spec, known = check.spec, check.target.joints
    for place, joint in enumerate(spec.joints):
        if joint not in known:
            message = f"{check.target.words} has no joint '{joint}'{nearest(joint, known)}"
            yield check.problem("joints", place, message=message, valid=known)
        elif check.description.keys == ("joint",) and joint not in spec.parameters:
            message = f"joint '{joint}' is listed but has no parameters"
            yield check.problem("joints", place, message=message)


def _key_problems(check: _Check, key: str) -> Iterator[Problem]:
    kinds, joints, bodies = check.description.keys, check.target.joints, check.target.bodies
    words = " or ".join(KIND_IN_WORDS[kind] for kind in kinds)
    if "pair" in kinds:
        joint, arrow, other = key.partition(PAIR)
        fits = bool(arrow) and joint in joints and other in joints and joint != other
        named: tuple[str, ...] = (joint,)
    elif "joint" in kinds:
        fits, named = key in joints, (key,)
    elif "surface" in kinds:
        fits, named = surface_index(key) is not None, ()
    else:
        fits, named = (key in bodies) if "body" in kinds else key in kinds, ()
    if not fits:
        choices = (
            bodies
            if "body" in kinds
            else joints
            if kinds[0] in {"joint", "pair"}
            else ("surface0", "surface1")
            if "surface" in kinds
            else kinds
        )
        message = (
            f"{check.spec.effect} takes its numbers for {words}; '{key}' is not one{nearest(key, choices)}"
        )
        yield check.problem("parameters", key, message=message, valid=choices, at="key")
    elif any(joint not in check.spec.joints for joint in named):
        message = f"'{named[0]}' has parameters but is not listed under joints"
        yield check.problem("parameters", key, message=message, at="key")


def _number_problems(check: _Check, key: str) -> Iterator[Problem]:
    description, given = check.description, check.spec.parameters[key]
    fine = True
    for symbol, quantity in given.items():
        if symbol not in description.symbols:
            fine = False
            message = f"{description.id} has no parameter '{symbol}'{nearest(symbol, description.symbols)}"
            yield check.problem(
                "parameters", key, symbol, message=message, valid=description.symbols, at="key"
            )
            continue
        found = list(_quantity_problems(check, key, description.parameter(symbol), quantity))
        fine = fine and not found
        yield from found
    for parameter in description.parameters:
        if parameter.left_out is None and parameter.symbol not in given:
            fine = False
            message = f"lacks '{parameter.symbol}' [{parameter.unit}], {parameter.meaning}"
            yield check.problem("parameters", key, message=message, at="key")
    if fine:
        for message in check.effect.relations(numbers(given)):
            yield check.problem("parameters", key, message=message, at="key")


def _quantity_problems(
    check: _Check, key: str, parameter: Parameter, quantity: PatchQuantity
) -> Iterator[Problem]:
    symbol = parameter.symbol
    unit = parameter.linear_unit if check.slides(key) and parameter.linear_unit else parameter.unit
    if not same_unit(quantity.unit, (unit,)):
        message = f"{symbol} is in {unit}, not in '{quantity.unit}'"
        yield check.problem("parameters", key, symbol, "unit", message=message, valid=(unit,))
    if not parameter.admits(quantity.value):
        message = f"{symbol} = {quantity.value:g} {unit} is not physical"
        yield check.problem("parameters", key, symbol, "value", message=message, valid=(parameter.bounds,))


def numbers(quantities: Mapping[str, PatchQuantity]) -> dict[str, float]:
    """Strips units: symbol -> value."""
    return {symbol: quantity.value for symbol, quantity in quantities.items()}


def _repeat_problems(checks: list[_Check]) -> Iterator[Problem]:
    """Finds numbers of the robot that are replaced twice."""
    seen: set[tuple[str, str]] = set()
    for check in checks:
        if check.spec.effect not in CATALOGUE or not check.effect.replaces:
            continue
        for key in check.spec.parameters:
            if (check.spec.effect, key) in seen:
                message = f"'{key}' has a {check.spec.effect} already; it replaces a number and cannot add up"
                yield check.problem("parameters", key, message=message, at="key")
            seen.add((check.spec.effect, key))


def _one_way_problems(checks: list[_Check]) -> Iterator[Problem]:
    """Finds viscous friction that would push in one direction: |dv| above the joint's viscous friction."""
    for check in checks:
        if check.spec.effect != "asymmetric_friction":
            continue
        for key, quantities in check.spec.parameters.items():
            own = check.target.motor_damping[key] if check.spec.port == "actuator" else 0.0
            viscous = own + sum(
                other.spec.parameters[key]["fv"].value
                for other in checks
                if other.spec.effect == "viscous_friction"
                and other.spec.port == check.spec.port
                and key in other.spec.parameters
            )
            dv = abs(quantities["dv"].value) if "dv" in quantities else 0.0
            if dv > viscous:
                message = (
                    f"|dv| {dv:g} N.m.s/rad is above the joint's viscous friction {viscous:g}: it would push"
                )
                yield check.problem("parameters", key, "dv", message=message)
