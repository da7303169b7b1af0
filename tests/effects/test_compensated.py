# SPDX-License-Identifier: BSD-3-Clause
"""A spring that the robot may compensate is spoken of where it may be, and nowhere else."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from impedance_modules.diagnosis.model_selection.conclusion import compensation_note


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
        recording(residuals=("link",)),
        recording("robot", ("actuator",)),
    ],
)
def test_without_commands_sensors_or_compensation_there_is_no_such_spring(other) -> None:
    assert compensation_note([recording(), other], [cause("crosstalk")]) == ()
