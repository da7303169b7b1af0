# SPDX-License-Identifier: BSD-3-Clause
"""What the catalogue says of compensation: who can, by which numbers, and who is refused, where and why."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.compensate import PatchCompensation, compensate_patch
from impedance_modules.effects.compensation_builder import SPEEDS, speeds
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.joint_motion import JointSample
from impedance_modules.errors import BadFile
from impedance_modules.spec.patch_file import read_patch
from tests.effects.test_effects_catalogue import entry, key_of, robot
from tests.support.effect_recordings import patch_with, write_patch

PORTS = [(name, port) for name, effect in CATALOGUE.items() for port in effect.description.ports]
CARRIED = ("parallel_spring", "link")
"""The one that depends on the robot: this one carries its springs by itself."""

CASES = [(name, port) for name, port in PORTS if (name, port) != CARRIED]
COMPENSATED = [case for case in CASES if case[1] in CATALOGUE[case[0]].compensated_at]
REFUSED = [case for case in CASES if case not in COMPENSATED]

JOINT = key_of("coulomb_friction")


def compensated(*entries: dict[str, object]) -> PatchCompensation:
    return compensate_patch(robot(), patch_with(*entries))


def with_std(effect: str, numbers: dict[str, tuple[float, float]]) -> dict[str, object]:
    """An entry whose numbers have standard deviations."""
    units = {p.symbol: p.unit for p in CATALOGUE[effect].description.parameters}
    quantities = {
        symbol: {"value": value, "std": std, "unit": units[symbol]}
        for symbol, (value, std) in numbers.items()
    }
    return {**entry(effect, "actuator"), "parameters": {JOINT: quantities}}


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_every_effect_says_whether_it_is_compensated(name: str) -> None:
    effect = CATALOGUE[name]
    assert set(effect.compensated_at) <= set(effect.description.ports)
    assert bool(effect.compensated_at) == (effect.compensation is not None)
    if set(effect.compensated_at) != set(effect.description.ports):
        assert effect.not_compensated != CATALOGUE["coulomb_friction"].not_compensated, "a reason of its own"


@pytest.mark.parametrize(("name", "port"), COMPENSATED)
def test_an_effect_that_can_be_is_compensated(name: str, port: str) -> None:
    found = compensated(entry(name, port))
    only, n = found.effects[0], found.numbers
    assert (only.name, only.keys, only.kind) == (name, (key_of(name),), CATALOGUE[name].compensation)
    torques = (n.offset, n.stiffness, n.ahead, n.back, n.per_load, n.gain - 1.0)
    assert n.robot is not None or any(np.any(torque) for torque in torques)


@pytest.mark.parametrize(("name", "port"), REFUSED)
def test_what_cannot_be_is_refused_at_its_line(tmp_path: Path, name: str, port: str) -> None:
    path = write_patch(tmp_path, entry("coulomb_friction", "actuator"), entry(name, port))
    line = 1 + [k for k, text in enumerate(path.read_text().splitlines()) if "effect: " in text][1]
    with pytest.raises(BadFile) as refused:
        compensate_patch(robot(), read_patch(path))
    (problem,) = refused.value.problems
    assert (problem.file, problem.line, problem.path) == (path, line, "effects[1].effect")
    assert problem.message.startswith(name) and "is not compensated: " in problem.message


def test_all_that_is_refused_is_refused_at_once() -> None:
    with pytest.raises(BadFile) as refused:
        compensated(entry("backlash", "actuator"), entry("torque_saturation", "actuator"))
    assert [problem.path for problem in refused.value.problems] == ["effects[0].effect", "effects[1].effect"]


def test_a_spring_that_the_robot_carries_is_not_wound_twice() -> None:
    with pytest.raises(BadFile, match=r"carries its own weight.*bench_spring"):
        compensated(entry(*CARRIED))


def test_a_gain_whose_interval_reaches_zero_is_refused() -> None:
    with pytest.raises(BadFile, match="reaches zero"):
        compensated(with_std("torque_gain", {"s": (0.5, 0.3)}))


@given(value=st.floats(0.4, 2.0), std=st.floats(0.0, 0.2))
def test_a_gain_is_divided_by_the_end_that_is_nearer_to_one(value: float, std: float) -> None:
    if value - 1.96 * std <= 0.0:
        return
    found, j = compensated(with_std("torque_gain", {"s": (value, std)})).numbers, index()
    low, high = value - 1.96 * std, value + 1.96 * std
    assert found.least_gain[j] == pytest.approx(low) and found.most_gain[j] == pytest.approx(high)
    assert low - 1e-12 <= found.gain[j] <= high + 1e-12
    assert abs(found.gain[j] - 1.0) <= min(abs(low - 1.0), abs(high - 1.0)) + 1e-12


def index() -> int:
    return compensated(entry("coulomb_friction", "actuator")).model.joint_names.index(JOINT)


FRICTIONS = {
    "coulomb_friction": {"fc": (0.2, 2.0)},
    "viscous_friction": {"fv": (0.2, 2.0)},
    "quadratic_drag": {"c": (0.2, 2.0)},
    "stribeck_friction": {"fc": (0.5, 1.0), "fs": (1.0, 2.0)},
    "asymmetric_friction": {"fc": (1.0, 2.0), "da": (-0.9, 0.9)},
}


@given(name=st.sampled_from(list(FRICTIONS)), seed=st.integers(0, 2**32 - 1))
@example(name="asymmetric_friction", seed=1168831089)
@settings(max_examples=60, deadline=None)
def test_friction_is_overcome_by_no_more_than_any_friction_of_the_interval(name: str, seed: int) -> None:
    """The table lies below the law at every number within 1.96 standard deviations, and on it without any.

    Some of these numbers are no friction: an asymmetry beyond the level would push. There nothing is overcome.
    """
    random, law = np.random.default_rng(seed), CATALOGUE[name]
    assert isinstance(law, JointLaw)
    middle = {symbol: float(random.uniform(*ends)) for symbol, ends in FRICTIONS[name].items()}
    std = 0.1 * float(random.uniform(0.1, 1.0))
    shape = {"vs": 0.2} if name == "stribeck_friction" else {}
    drawn = {symbol: value + std * random.uniform(-1.96, 1.96) for symbol, value in middle.items()}
    exact = {symbol: (value, 0.0) for symbol, value in (middle | shape).items()}
    spread = {symbol: (value, std) for symbol, value in middle.items()} | {
        symbol: (value, 0.0) for symbol, value in shape.items()
    }
    sure, known = (compensated(with_std(name, numbers)).numbers for numbers in (spread, exact))
    j = index()
    v = speeds(compensated(with_std(name, exact)).model.joints[j].velocity_max)
    v[0] = 1e-9
    for table, exact_table, sign in ((sure.ahead, known.ahead, 1.0), (sure.back, known.back, -1.0)):
        assert np.all(table[j] <= np.maximum(sign * consumed(law, sign * v, drawn | shape), 0.0) + 1e-9)
        np.testing.assert_allclose(
            exact_table[j], sign * consumed(law, sign * v, middle | shape), rtol=1e-6, atol=1e-9
        )
        assert np.all(table >= 0.0)


def consumed(law: JointLaw, velocity: np.ndarray, values: dict[str, float]) -> np.ndarray:
    coefficients, shape = law.linear(values)
    still = np.zeros(SPEEDS)
    sample = JointSample(still, still, velocity, still, still, regularisation=1e-12)
    return np.asarray(law.basis(sample, shape) @ coefficients)


def test_beyond_the_speeds_of_the_data_friction_is_taken_as_it_was_there() -> None:
    fitted = {"range": {"velocity": {JOINT: [-0.2, 0.5]}}}
    found = compensated({**with_std("viscous_friction", {"fv": (2.0, 0.0)}), **fitted}).numbers
    j = index()
    assert found.ahead[j].max() == pytest.approx(1.0) and found.back[j].max() == pytest.approx(0.4)


def test_what_fades_is_overcome_as_far_as_it_is_always_there() -> None:
    numbers = {"fv": (2.0, 0.0), "k": (0.6, 0.0), "T": (20.0, 0.0)}
    found = compensated(with_std("friction_drift", numbers)).numbers
    alone = compensated(with_std("viscous_friction", {"fv": (0.8, 0.0)})).numbers
    np.testing.assert_allclose(found.ahead, alone.ahead, rtol=1e-12)


def test_effects_on_one_joint_add() -> None:
    first, second = entry("coulomb_friction", "actuator"), entry("viscous_friction", "link")
    together = compensated(first, second).numbers
    alone = [compensated(one).numbers for one in (first, second)]
    np.testing.assert_allclose(together.ahead, sum(one.ahead for one in alone))
