# SPDX-License-Identifier: BSD-3-Clause
"""Choosing causes: which of several goes when not all are needed, which are noise, and what may stand behind one."""

from types import SimpleNamespace

import pytest

from impedance_modules.diagnosis.model_selection import backward_elimination
from impedance_modules.diagnosis.model_selection.conclusion import compensation_note

SPRING, OFFSET, ASYMMETRY = (
    SimpleNamespace(name=name, groups=(group,))
    for name, group in (("spring", 0), ("offset", 2), ("asymmetry", 2))
)
ELIMINATED = {
    "what passes its tests stays": ([SPRING, OFFSET], lambda name, beside: True, ["spring", "offset"]),
    "what fails them goes": ([SPRING, OFFSET], lambda name, beside: name == "spring", ["spring"]),
    # An asymmetry takes over part of an offset's work and is nothing without it: the offset is the cause.
    "what depends on another cause goes before that": (
        [SPRING, OFFSET, ASYMMETRY],
        lambda name, beside: {"offset": "asymmetry" not in beside, "asymmetry": "offset" in beside}.get(name, True),
        ["spring", "offset"],
    ),
    "what another cause replaces goes": (
        [OFFSET, ASYMMETRY],
        lambda name, beside: name != "offset" or "asymmetry" not in beside,
        ["asymmetry"],
    ),
    "what depends on it does not keep a cause that is none": (
        [OFFSET, ASYMMETRY],
        lambda name, beside: name == "asymmetry" and "offset" in beside,
        [],
    ),
}  # fmt: skip
"""A model, whether a cause stands beside others, and what is left of the model."""


@pytest.mark.parametrize("rule", ELIMINATED)
def test_backward_elimination(monkeypatch, rule) -> None:
    model, stands, left = ELIMINATED[rule]
    monkeypatch.setattr(
        backward_elimination, "try_term", lambda beside, one: (one, {other.name for other in beside})
    )

    def objection(trial):
        return None if stands(trial[0].name, trial[1]) else "no"

    found = backward_elimination.eliminate_backward(model, list, objection)
    assert [one.name for one in found] == left


def recording(compensation: str = "robot", residuals: tuple[str, ...] = ("link", "actuator", "velocity")):
    return SimpleNamespace(residuals=residuals, log=SimpleNamespace(gravity_compensation=compensation))


def cause(effect: str, *equivalent: str):
    also = tuple(SimpleNamespace(effect=name) for name in equivalent)
    return SimpleNamespace(effect=effect, joints=("elbow",), equivalent=also)


@pytest.mark.parametrize(
    ("causes", "named"),
    [
        ([cause("crosstalk")], "crosstalk on elbow"),
        ([cause("viscous_friction"), cause("parallel_spring")], None),
        ([cause("parallel_spring"), cause("crosstalk")], None),
        ([cause("torque_offset", "parallel_spring")], "torque_offset on elbow"),
        ([cause("viscous_friction", "coulomb_friction")], None),
        ([], None),
    ],
)
def test_the_note_names_what_such_a_spring_may_be_behind(causes, named) -> None:
    found = compensation_note([recording(), recording()], causes)
    assert len(found) == (named is not None)
    if named is not None:
        assert found[0].startswith(f"{named}: ") and "without effort_command" in found[0]


@pytest.mark.parametrize(
    "other",
    [
        recording("none"),
        recording("command"),
        recording("robot", ("link",)),
        recording("robot", ("actuator",)),
    ],
)
def test_without_commands_sensors_or_compensation_there_is_no_such_spring(other) -> None:
    assert compensation_note([recording(), other], [cause("crosstalk")]) == ()
