# SPDX-License-Identifier: BSD-3-Clause
"""What a probe shall answer: pairs of hypotheses, the first with a known size, the second with any."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.effects.catalogue import CATALOGUE, first_excitation
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.regressor import PAIR
from impedance_modules.effects.residual_kinds import RESIDUALS, Residual
from impedance_modules.errors import BadInput

SLIGHT = 0.005
"""Part of the gap below which a cause's rivals are not worth a recording."""

UNKNOWN_GAP = 5.0
"""Assumed error of the model's torque without a diagnosis, over the noise."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect on a joint, pair of joints or body.

    Attributes:
        effect: Id.
        key: Joint, pair or body that its parameters belong to.
        ports: Where it may act; all of the effect's where nothing is known.
        values: Its parameters; None: unknown.
    """

    effect: str
    key: str
    ports: tuple[Port, ...]
    values: Mapping[str, float] | None

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.effect} on {self.key}"


@dataclass(frozen=True)
class ProbeQuestion:
    """Two hypotheses to distinguish, and the joints whose motion can do it."""

    first: Hypothesis
    second: Hypothesis
    joints: tuple[str, ...]

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.first.name} or {self.second.name}"


@dataclass(frozen=True)
class ProbeRequest:
    """All questions that a probe must answer.

    Attributes:
        purpose: In words.
        questions: All pairs.
        residuals: Residuals that the recordings provide.
        noise: (residual, joint) -> rms of its noise.
        start: Joint -> angle about which was recorded [rad]; empty where nothing is known.
        gap: Joint -> rms torque by which the model was wrong [N.m].
    """

    purpose: str
    questions: tuple[ProbeQuestion, ...]
    residuals: tuple[Residual, ...]
    noise: Mapping[tuple[Residual, str], float]
    start: Mapping[str, float]
    gap: Mapping[str, float]


def request_of_diagnosis(answer: Mapping[str, Any], tree: RigidTree) -> ProbeRequest:
    """Reads the open questions of a diagnosis.

    First the rivals of its ambiguous causes, without those that explain hardly anything; else joints that hardly
    moved; else every joint.

    Args:
        answer: A diagnosis JSON that its schema has admitted.
        tree: Joints and bodies of the model.

    Raises:
        BadInput: The diagnosis names a joint that the model lacks, or an effect that is not in the catalogue.
    """
    joints = tree.joints
    gaps = answer["gap"]["per_port"]
    residuals = tuple(name for name in RESIDUALS if any(gap["residual"] == name for gap in gaps))
    noise = {(gap["residual"], gap["joint"]): float(gap["noise_floor"]) for gap in gaps}
    gap = {
        joint: max(
            float(item["before"])
            for item in gaps
            if item["joint"] == joint and item["residual"] != "velocity"
        )
        for joint in dict.fromkeys(item["joint"] for item in gaps if item["residual"] != "velocity")
    }
    strange = next((joint for _, joint in noise if joint not in joints), None)
    if strange is not None:
        raise BadInput(f"the diagnosis names joint '{strange}', the model has {', '.join(joints)}")
    start = {name: float(q) for name, q in answer["next_motion"].get("start", {}).items() if name in joints}
    open_pairs = tuple(_open(answer["causes"], tree))
    weak = tuple(name for name in answer["data"].get("weak_joints", ()) if name in joints)
    if open_pairs:
        purpose = "tell apart: " + "; ".join(dict.fromkeys(question.name for question in open_pairs))
        return ProbeRequest(purpose, open_pairs, residuals, noise, start, gap)
    if weak:
        purpose = f"see joints that hardly moved: {', '.join(weak)}"
        return ProbeRequest(purpose, general_questions(weak), residuals, noise, start, gap)
    return ProbeRequest(
        "see every joint in every way: the diagnosis leaves no pair open",
        general_questions(joints),
        residuals,
        noise,
        start,
        gap,
    )


def general_request(joints: Sequence[str], noise: Mapping[tuple[Residual, str], float]) -> ProbeRequest:
    """The questions without a diagnosis: the common effects of every joint."""
    residuals = tuple(dict.fromkeys(name for name, _ in noise))
    gap = {joint: UNKNOWN_GAP * size for (_, joint), size in noise.items()}
    return ProbeRequest("see every joint in every way", general_questions(joints), residuals, noise, {}, gap)


def with_assumed_noise(request: ProbeRequest, assumed: Mapping[tuple[Residual, str], float]) -> ProbeRequest:
    """Adds what is assumed of joints that the diagnosed recordings lack, so that they can be asked about, too.

    Args:
        request: Of a diagnosis.
        assumed: (residual, joint) -> rms of a torque's noise [N.m], of every joint of the model.
    """
    seen = {joint for _, joint in request.noise}
    sizes = {joint: size for (_, joint), size in assumed.items() if joint not in seen}
    torques = [residual for residual in request.residuals if residual != "velocity"]
    noise: dict[tuple[Residual, str], float] = {
        (residual, joint): size for joint, size in sizes.items() for residual in torques
    }
    gap = {joint: UNKNOWN_GAP * size for joint, size in sizes.items()}
    return replace(request, noise={**request.noise, **noise}, gap={**request.gap, **gap})


def general_questions(joints: Sequence[str]) -> tuple[ProbeQuestion, ...]:
    """All pairs of common effects, joint by joint."""
    out: list[ProbeQuestion] = []
    for joint in joints:
        hypotheses = [_hypothesis(effect, joint, None, None) for effect in first_excitation()]
        for index, first in enumerate(hypotheses):
            out.extend(ProbeQuestion(first, second, (joint,)) for second in hypotheses[index + 1 :])
    return tuple(out)


def _open(causes: Sequence[Mapping[str, Any]], tree: RigidTree) -> Iterator[ProbeQuestion]:
    for cause in causes:
        if cause["weight"] < SLIGHT:
            continue
        for key, symbols in cause["parameters"].items():
            values = {symbol: float(number["value"]) for symbol, number in symbols.items()}
            first = _hypothesis(cause["effect"], key, cause["port"], values)
            own = key.partition(PAIR)[0]
            mine = (own,) if own in tree.joints else tuple(cause["joints"])
            for rival in cause["equivalent"]:
                theirs = tuple(rival["joints"])
                of_another_joint = set(theirs) & set(cause["joints"]) and not set(theirs) & set(mine)
                if of_another_joint and not _of_bodies(rival["effect"]):
                    continue
                joints = dict.fromkeys(
                    [*_showing(cause["effect"], mine, tree), *_showing(rival["effect"], theirs, tree)]
                )
                for other in _keys(rival["effect"], theirs or (key,), tree):
                    second = _hypothesis(rival["effect"], other, None, None)
                    yield ProbeQuestion(first, second, tuple(joints) or tree.joints)


def _of_bodies(effect: str) -> bool:
    """Whether an effect's parameters belong to a body: it then shows on every joint before the body."""
    return effect in CATALOGUE and "body" in CATALOGUE[effect].description.keys


def _showing(effect: str, joints: Sequence[str], tree: RigidTree) -> tuple[str, ...]:
    """Joints on which an effect shows: for a body those that carry it, too, the nearest first."""
    if not _of_bodies(effect):
        return tuple(joints)
    found = []
    for joint in (name for name in joints if name in tree.joints):
        place: int | None = tree.joints.index(joint)
        while place is not None:
            found.append(tree.joints[place])
            place = tree.bodies[place].parent
    return tuple(dict.fromkeys(found))


def _keys(effect: str, theirs: Sequence[str], tree: RigidTree) -> tuple[str, ...]:
    """Joints, bodies behind them, or pairs of joints that a rival's parameters belong to."""
    if effect not in CATALOGUE:
        return tuple(theirs)
    kinds = CATALOGUE[effect].description.keys
    if "body" in kinds:
        return tuple(body.link for body in tree.bodies if body.joint in theirs)
    if "pair" in kinds:
        return tuple(
            f"{one}{PAIR}{other}"
            for one in theirs
            if one in tree.joints
            for other in _neighbours(one, tree.joints)
        )
    if "joint" in kinds:
        return tuple(theirs)
    return tuple(kinds)


def _neighbours(joint: str, joints: Sequence[str]) -> tuple[str, ...]:
    """The joints listed before and after one."""
    place = joints.index(joint)
    return tuple(joints[i] for i in (place - 1, place + 1) if 0 <= i < len(joints))


def _hypothesis(effect: str, key: str, port: str | None, values: Mapping[str, float] | None) -> Hypothesis:
    if effect not in CATALOGUE:
        raise BadInput(
            f"the diagnosis names '{effect}', which is not in the catalogue ({', '.join(CATALOGUE)})"
        )
    ports = CATALOGUE[effect].description.ports
    return Hypothesis(effect, key, ports if port is None else (cast("Port", port),), values)
