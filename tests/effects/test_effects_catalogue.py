# SPDX-License-Identifier: BSD-3-Clause
"""The catalogue as the contract has it: ids, symbols, patches that teach, what the model knows, the verb."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from docs import effects_tables
from impedance_modules.effects.apply import apply_patch, apply_to_plant, apply_to_surfaces
from impedance_modules.effects.carried_object import CarriedObject
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect_description import Parameter, Place, same_unit
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.residual_kinds import RESIDUALS
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec
from tests.support.arm_samples import derivative
from tests.support.commands import invoke, refusal
from tests.support.effect_recordings import applied as effect_with
from tests.support.effect_recordings import patch_with, signals_of, write_patch
from tests.support.paths import CHECKOUT

SIX_JOINTS = CHECKOUT / "tests" / "robots" / "six_joint_pair"
CONTRACT = [
    "coulomb_friction", "viscous_friction", "stribeck_friction", "quadratic_drag", "asymmetric_friction",
    "load_dependent_friction", "friction_drift", "torque_offset", "reflected_inertia", "torque_gain",
    "encoder_offset", "backlash", "hysteresis", "joint_elasticity", "payload", "link_inertia", "base_tilt",
    "parallel_spring", "torque_ripple", "command_delay", "actuator_lag", "torque_saturation", "crosstalk",
    "velocity_filter_lag", "clock_drift", "external_contact", "controller_gain", "transmission_coupling",
    "surface_height", "surface_stiffness", "surface_friction", "buoyancy", "added_mass", "fluid_drag",
    "bench_spring", "object_inertia",
]  # fmt: skip
"""Ids that patches may already contain: none of them may vanish."""
SYMBOLS = {
    "coulomb_friction": "fc", "viscous_friction": "fv", "stribeck_friction": "fc fs vs", "quadratic_drag": "c",
    "torque_offset": "c", "crosstalk": "c", "asymmetric_friction": "fc da dv", "load_dependent_friction": "kl",
    "friction_drift": "fv k T", "reflected_inertia": "Ia", "torque_gain": "s", "encoder_offset": "dq0",
    "backlash": "b", "hysteresis": "s0 fc", "joint_elasticity": "K", "payload": "m cx cy cz", "link_inertia": "dm",
    "base_tilt": "rx ry", "parallel_spring": "k q0 preload", "torque_ripple": "A N", "command_delay": "T",
    "actuator_lag": "T", "velocity_filter_lag": "T", "torque_saturation": "limit", "clock_drift": "ppm",
}  # fmt: skip
"""Fixed by design 3.3."""

EXAMPLES = {
    "stribeck_friction": {"fc": 0.5, "fs": 0.8, "vs": 0.1},
    "asymmetric_friction": {"fc": 0.5, "da": 0.2},
    "parallel_spring": {"k": 12.0, "q0": -0.4},
    "link_inertia": {"dm": 0.3},
    "bench_spring": {"k": 12.0, "q0": -0.4},
    "transmission_coupling": {"Ia": 0.01},
    "external_contact": {"fx": 1.0, "fy": 0.0, "fz": -2.0, "start": 0.5, "end": 1.0},
    "load_dependent_friction": {"kl": 0.1},
    "added_mass": {"mx": 0.5, "mz": 0.1, "cx": 0.0, "cy": 0.0, "cz": 0.1},
    "fluid_drag": {"dy": 8.0, "cx": 0.0, "cy": 0.0, "cz": 0.1},
    "object_inertia": {"m": 0.3},
}


@cache
def robot() -> RobotSpec:
    return read_robot(SIX_JOINTS)


KEYS = {
    "joint": "port_lift", "pair": "port_roll<-port_spin", "body": "port_palm", "base": "base", "log": "log",
    "surface": "surface0", "object": "object",
}  # fmt: skip


def key_of(effect: str) -> str:
    return KEYS[CATALOGUE[effect].description.keys[0]]


def numbers_of(effect: str) -> dict[str, float]:
    if effect in EXAMPLES:
        return EXAMPLES[effect]
    return {p.symbol: 0.25 for p in CATALOGUE[effect].description.parameters if p.left_out is None}


def entry(effect: str, port: str, numbers: dict[str, float] | None = None) -> dict[str, object]:
    return effect_with(
        effect, port, key_of(effect), **(numbers_of(effect) if numbers is None else numbers)
    ).entry()


def given_as(effect: str, port: str, key: str, symbol: str, value: float, unit: str) -> dict[str, object]:
    """An entry with one number, under a key and in a unit that may be wrong."""
    return {**entry(effect, port), "parameters": {key: {symbol: {"value": value, "unit": unit}}}}


def test_the_catalogue_is_the_contract() -> None:
    assert set(CONTRACT) <= set(CATALOGUE)
    for effect, symbols in SYMBOLS.items():
        assert set(symbols.split()) <= set(CATALOGUE[effect].description.symbols), effect
    schema = json.loads((CHECKOUT / "schemas" / "patch.schema.json").read_text())
    allowed = schema["$defs"]["effect"]["properties"]
    assert set(CATALOGUE) == set(allowed["effect"]["enum"])
    for effect in CATALOGUE.values():
        assert set(effect.description.ports) <= set(allowed["port"]["enum"])


@pytest.mark.parametrize("effect", list(CATALOGUE))
def test_a_description_leaves_nothing_out(effect: str) -> None:
    described = CATALOGUE[effect].description
    texts = (described.sentence, described.equation, described.signature, described.excitation)
    assert all(len(text) >= 10 for text in (*texts, described.applied)) and described.reference
    assert described.sentence.endswith(".") and described.ports and described.keys and described.parameters
    assert set(described.confusable_with) <= set(CATALOGUE) - {effect} and described.confusable_with
    assert all(p.unit and p.meaning for p in described.parameters)


@pytest.mark.parametrize(
    ("effect", "port"), [(e, port) for e in CATALOGUE for port in CATALOGUE[e].description.ports]
)
def test_a_patch_is_read_applied_and_described(tmp_path: Path, effect: str, port: str) -> None:
    patch = read_patch(write_patch(tmp_path, entry(effect, port)))
    applied = apply_patch(robot(), patch)
    assert apply_to_plant(RobotModel(applied), patch).command_delay >= 0.0
    only = patch.effects[0]
    found = {symbol: quantity.value for symbol, quantity in only.parameters[key_of(effect)].items()}
    assert (only.effect, only.port, found) == (effect, port, numbers_of(effect))
    shown = invoke("effects", effect).output
    assert effect in shown and all(symbol in shown for symbol in found)


@given(seed=st.integers(0, 2**32 - 1), effect=st.sampled_from(list(CATALOGUE)))
@settings(max_examples=80, deadline=None)
def test_coefficients_and_parameters_are_two_names_of_one_thing(seed: int, effect: str) -> None:
    random, s, entry_of = np.random.default_rng(seed), recording(), CATALOGUE[effect]
    described = entry_of.description
    for port in described.ports:
        given = [p for p in described.parameters if p.left_out is None or p.symbol not in ("q0", "D")]
        values = {p.symbol: drawn(p, random) for p in given}
        if effect == "clock_drift":  # only efforts with a clock of their own have an age at the start
            values["T"] = values["T"] if round(values["apart"]) == 2 else 0.0
        site = Site(s, key_of(effect), port)
        coefficients, shape = entry_of.coefficients(values, site)
        again = entry_of.values(coefficients, shape, site)
        for symbol, value in again.items():
            assert value == pytest.approx(values[symbol], rel=1e-9, abs=1e-12), (port, symbol)


def drawn(parameter: Parameter, random: np.random.Generator) -> float:
    """A random value within a parameter's physical bounds."""
    low = max(parameter.lower, -0.5) if math.isfinite(parameter.lower) else -0.5
    high = min(parameter.upper, 2.0)
    return float(random.uniform(low + 1e-3, high))


PLANE = SurfaceSpec("plane", 0.3, None, (0.1, 0.0, 0.0), None, 900.0, 5.0, 0.4)


BOX = ObjectSpec(("port",), "box", 0.6, (0.1, 0.2, 0.3), None, "weld", None, 0.0, False)
CARRIED = CarriedObject(
    BOX, "port_palm", np.array([0.0, 0.1, 0.05]), np.eye(3), np.array([3e-3, 2e-3, 1e-3]), np.arange(80) > 30
)


@cache
def recording() -> Signals:
    """Any motion at all."""
    model = RobotModel(robot())
    random = np.random.default_rng(5)
    motion = [random.normal(size=(80, model.n)) for _ in range(6)]
    around = {"surfaces": (PLANE,), "hands": ("port_palm",), "carried": CARRIED}
    return signals_of(model, np.arange(80) / 100.0, *motion, **around)


@pytest.mark.parametrize("effect", list(CATALOGUE))
def test_every_shape_gives_columns_within_its_bounds_somewhere(effect: str) -> None:
    one, s, seen = CATALOGUE[effect], recording(), False
    for port in one.description.ports:
        site = Site(s, key_of(effect), port)
        for shape in one.shapes(site)[:3]:
            for residual in RESIDUALS:
                found = one.regressor(site, residual, shape)
                if found is None:
                    continue
                seen = True
                assert found.columns.shape == (s.samples, len(found.rows), found.lower.size)
                assert found.fixed.shape == found.columns.shape[:2]
                assert np.all(found.lower <= found.upper)
                assert np.isfinite(found.columns).all() and np.isfinite(found.fixed).all()
    assert seen


@pytest.mark.parametrize("sensor", ["joint_sensor", "none"])
@pytest.mark.parametrize("effect", list(CATALOGUE))
def test_shapes_have_the_same_columns_together_and_one_by_one(effect: str, sensor: str) -> None:
    s, one = recording(), CATALOGUE[effect]
    if sensor == "none":  # then torques of links go through springs to the motors, too
        s = replace(s, effort=None, effort_source="none")
    for port in one.description.ports:
        site = Site(s, key_of(effect), port)
        shapes = one.shapes(site)[:5]
        for residual in RESIDUALS:
            together = one.regressors(site, residual, shapes)
            assert len(together) == len(shapes)
            for shape, found in zip(shapes, together, strict=True):
                alone = one.regressor(site, residual, shape)
                assert (found is None) == (alone is None)
                if found is None or alone is None:
                    continue
                assert found.rows == alone.rows
                np.testing.assert_array_equal(found.lower, alone.lower)
                np.testing.assert_array_equal(found.upper, alone.upper)
                np.testing.assert_allclose(found.columns, alone.columns, rtol=1e-12, atol=1e-12)
                np.testing.assert_allclose(found.fixed, alone.fixed, rtol=1e-12, atol=1e-12)


def test_a_link_side_sensor_sees_no_rotor_and_a_motor_sees_both_frictions() -> None:
    s = recording()
    rotor, rub = CATALOGUE["reflected_inertia"], CATALOGUE["coulomb_friction"]
    motor, link = Site(s, "port_lift", "actuator"), Site(s, "port_lift", "link")
    assert rotor.regressor(motor, "link", {}) is None
    assert rub.regressor(motor, "link", {}) is None
    assert rub.regressor(link, "actuator", {}) is None
    for site in (motor, link):
        assert rub.regressor(site, "motor", {}) is not None


LINK, CENTRE = "link", {"cx": 0.0, "cy": 0.0, "cz": 0.0}
BROKEN = {
    "water on a joint": (given_as("buoyancy", LINK, "port_lift", "m", 1, "kg"), "numbers for a link that moves"),
    "water that sinks": (entry("buoyancy", LINK, {"m": -1.0, **CENTRE}), "not physical (valid: at least 0)"),
    "no water taken along": (entry("added_mass", LINK, CENTRE), "takes no water along"),
    "no drag": (entry("fluid_drag", LINK, CENTRE), "in no direction"),
    "no object": (given_as("object_inertia", LINK, "box", "m", 0.1, "kg"), "'box' is not one"),
    "no surface": (given_as("surface_height", "contact", "table", "dh", 0.1, "m"), "(valid: surface0, surface1)"),
    "wrong port": (entry("viscous_friction", "sensor"), "(valid: actuator, link)"),
    "wrong symbol": (given_as("viscous_friction", LINK, "port_lift", "fx", 1, "1"), "did you mean 'fv'?"),
    "missing symbol": (entry("stribeck_friction", LINK, {"fc": 0.1, "fs": 0.2}), "lacks 'vs' [rad/s]"),
    "wrong unit": (given_as("viscous_friction", LINK, "port_lift", "fv", 1, "N"), "fv is in N.m.s/rad, not in 'N'"),
    "negative friction": (entry("coulomb_friction", LINK, {"fc": -0.1}), "not physical (valid: at least 0)"),
    "negative inertia": (entry("reflected_inertia", "actuator", {"Ia": -0.1}), "not physical"),
    "negative spring": (entry("parallel_spring", LINK, {"k": -1.0, "q0": 0.0}), "not physical"),
    "no spring's rest": (entry("parallel_spring", LINK, {"k": 1.0}), "exactly one of q0 and preload"),
    "friction that falls to rest": (
        entry("stribeck_friction", LINK, {"fc": 2.0, "fs": 1.0, "vs": 0.1}), "fs 1 is below fc 2",
    ),
    "friction that pushes": (entry("asymmetric_friction", LINK, {"fc": 1.0, "da": 2.0}), "above fc"),
    "viscous friction that pushes": (
        entry("asymmetric_friction", LINK, {"fc": 1.0, "da": 0.0, "dv": 0.5}), "above the joint's viscous friction",
    ),
    "unknown joint": (
        {**entry("viscous_friction", LINK), "joints": ["port_lift", "port_lif"]}, "did you mean 'port_lift'?",
    ),
    "joint without numbers": (
        {**entry("viscous_friction", LINK), "joints": ["port_lift", "port_bend"]}, "has no parameters",
    ),
    "numbers of an unlisted joint": ({**entry("viscous_friction", LINK), "joints": []}, "not listed"),
    "a joint for a pair": (given_as("crosstalk", "sensor", "port_lift", "c", 0.1, "1"), "JOINT<-OTHER"),
    "unknown link": (
        effect_with("payload", LINK, "port_pal", **numbers_of("payload")).entry(), "did you mean 'port_palm'?",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_wrong_patch_is_told_where_and_what(tmp_path: Path, name: str) -> None:
    broken, words = BROKEN[name]
    path = write_patch(tmp_path, broken)
    with pytest.raises(BadFile) as caught:
        apply_patch(robot(), read_patch(path))
    assert words in str(caught.value)
    place = next(i for i, line in enumerate(path.read_text().splitlines(), 1) if "effects:" in line)
    assert all(problem.line > place and problem.column > 1 for problem in caught.value.problems)


def test_all_problems_come_at_once_with_their_lines(tmp_path: Path) -> None:
    path = write_patch(
        tmp_path, BROKEN["wrong port"][0], BROKEN["negative friction"][0], BROKEN["wrong unit"][0]
    )
    with pytest.raises(BadFile) as caught:
        apply_patch(robot(), read_patch(path))
    lines = path.read_text().splitlines()
    pointed = [lines[p.line - 1][p.column - 1 :] for p in caught.value.problems]
    assert pointed == ["sensor", "-0.1", "N"]


def test_a_patch_for_another_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="is for robot 'other'"):
        apply_patch(robot(), read_patch(write_patch(tmp_path, entry("payload", "link"), robot="other")))


def test_a_replaced_number_is_replaced_once(tmp_path: Path) -> None:
    twice = entry("reflected_inertia", "actuator")
    with pytest.raises(BadFile, match="already"):
        apply_patch(robot(), read_patch(write_patch(tmp_path, twice, twice)))


IMPOSSIBLE = (
    (entry("link_inertia", LINK, {"dm": -50.0}), "no physical body"),
    (entry("transmission_coupling", "actuator", {"Ia": 3.0}), "more than the two rotors can couple"),
    (effect_with("backlash", "actuator", "port_turn", b=0.01).entry(), "nothing between motor and link"),
)


@pytest.mark.parametrize(("bad", "words"), IMPOSSIBLE)
def test_what_no_robot_can_be_is_refused(tmp_path: Path, bad: dict[str, object], words: str) -> None:
    patch = read_patch(write_patch(tmp_path, bad))
    with pytest.raises(BadInput, match=words):
        apply_to_plant(RobotModel(apply_patch(robot(), patch)), patch)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_model_weighs_what_the_patch_adds(seed: int) -> None:
    """Weight of payload and springs, by formulas that share nothing with the catalogue."""
    random = np.random.default_rng(seed)
    model = RobotModel(robot())
    q = random.uniform(model.column("position_min"), model.column("position_max"))
    m, place = float(random.uniform(0.1, 2.0)), random.uniform(-0.1, 0.1, 3)
    text = [
        entry("payload", "link", {"m": m, **dict(zip(("cx", "cy", "cz"), map(float, place), strict=True))}),
        entry("parallel_spring", "link", {"k": 7.0, "q0": 0.3}),
    ]
    applied = RobotModel(apply_patch(robot(), patch_with(*text)))

    def height(step: np.ndarray) -> float:
        pose = model.pose(q + step, "port_palm")
        return float((pose.translation + pose.rotation @ place)[2])

    expected = m * 9.81 * derivative(height, model.n)
    lift = model.joint_names.index("port_lift")
    expected[lift] += 7.0 * (q[lift] - 0.3)
    assert np.allclose(applied.gravity(q) - model.gravity(q), expected, atol=1e-6)
    added = applied.mass_matrix(q) - model.mass_matrix(q)
    assert np.linalg.eigvalsh(added)[-1] > 0.0 and np.linalg.eigvalsh(added)[0] > -1e-9


def test_gravity_acts_sideways_on_a_tilted_model() -> None:
    applied = apply_patch(robot(), patch_with(entry("base_tilt", "link", {"rx": 0.1, "ry": 0.0})))
    assert np.allclose(applied.gravity, (0.0, -9.81 * math.sin(0.1), -9.81 * math.cos(0.1)))


def test_predictions_reckon_with_the_delay_that_the_plant_makes_joint_by_joint() -> None:
    patch = patch_with(entry("command_delay", "timing", {"T": 0.004}))
    applied = apply_patch(robot(), patch)
    assert applied.timing.command_delay == pytest.approx(robot().timing.command_delay + 0.004)
    delay = apply_to_plant(RobotModel(applied), patch).command_delay
    assert delay == pytest.approx(robot().timing.command_delay)


def test_units_may_be_written_as_people_write_them() -> None:
    for text in ("N.m.s/rad", "N·m·s/rad", "N*m*s/rad", "N m s/rad".replace(" ", ".")):
        assert same_unit(text, ("N.m.s/rad",))
    assert same_unit("kg.m2", ("kg.m^2",)) and not same_unit("kg.m", ("kg.m^2",))


def test_the_range_of_a_fit_is_kept() -> None:
    spring = {**entry("parallel_spring", "link"), "range": {"position": {"port_lift": [-1.5, -0.05]}}}
    assert patch_with(spring).effects[0].range == {"position": {"port_lift": (-1.5, -0.05)}}


def test_the_verb_lists_all_and_refuses_others() -> None:
    listed = invoke("effects").output
    assert all(effect in listed for effect in CATALOGUE)
    assert "coulomb_friction" in refusal("effects", "coulomb")


def test_the_robots_own_numbers_stay_as_they_were() -> None:
    before = replace(robot())
    apply_patch(robot(), patch_with(entry("payload", "link"), entry("reflected_inertia", "actuator")))
    assert robot() == before


def test_a_map_is_changed_as_the_patch_says_and_a_surface_too_many_is_refused() -> None:
    block = SurfaceSpec("box", None, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0), (1.0, 1.0, 0.2), 900.0, 5.0, 0.4)
    wrong = [
        entry("surface_height", "contact", {"dh": 0.02}),
        entry("surface_stiffness", "contact", {"k": 400.0}),
        entry("surface_friction", "contact", {"mu": 0.9}),
    ]
    found = apply_to_surfaces((PLANE, block), patch_with(*wrong))
    assert found[0] == replace(PLANE, height=0.32, stiffness=400.0, friction=0.9) and found[1] == block
    moved = apply_to_surfaces((block,), patch_with(wrong[0]))
    assert moved[0].position == pytest.approx((0.1, 0.2, 0.32))
    with pytest.raises(BadFile, match=r"no surface 'surface0'.*no environment"):
        apply_to_surfaces((), patch_with(wrong[0]))


def at_rest(signals: Signals, time: np.ndarray, **channels: object) -> Signals:
    """The recording of an arm that stands still at 0, with other channels."""
    still = np.zeros((time.size, signals.n))
    return replace(signals, time=time, position=still, velocity=still, acceleration=still, **channels)


@given(st.floats(0.3, 3.0), st.floats(50.0, 5000.0), st.booleans())
@settings(max_examples=20, deadline=None)
def test_torque_of_a_link_turns_the_rotor_behind_its_spring_too(
    hz: float, stiffness: float, sensed: bool
) -> None:
    """A tone, derived by hand: tau + (I_r d2/dt2 + D d/dt) tau / K; tau alone where a sensor reads the spring."""
    s, turn = recording(), 2.0 * np.pi * hz
    time = np.arange(1200) / 200.0
    inertia, damping = np.full(s.n, 0.4), np.full(s.n, 1.5)
    soft = at_rest(
        s,
        time,
        effort=np.zeros((time.size, s.n)) if sensed else None,
        spring_compliance=np.full(s.n, 1.0 / stiffness),
        reflected_inertia=inertia,
        motor_damping=damping,
        encoders=(),
        deflection_cutoffs=np.full(s.n, 15.0),
        effort_source="joint_sensor",
    )
    tone, slope = np.sin(turn * time), turn * np.cos(turn * time)
    expected = tone if sensed else tone + (0.4 * -(turn**2) * tone + 1.5 * slope) / stiffness
    for of_accelerations in (False, True):
        felt = soft.through_springs(tone[:, None], (1,), of_accelerations=of_accelerations)
        np.testing.assert_allclose(felt[300:-300, 0], expected[300:-300], rtol=1e-3, atol=2e-3)


def test_schema_and_docs_are_in_step_with_the_catalogue() -> None:
    behind = [str(path.relative_to(CHECKOUT)) for path in effects_tables.stale()]
    assert not behind, f"{behind} not up to date: run python -m docs.effects_tables"


def test_schema_and_docs_have_the_places_to_write_to() -> None:
    effects = (CHECKOUT / "docs" / "effects.md").read_text()
    assert effects_tables.TABLE.search(effects)
    assert effects_tables.COUNT.search(effects)
    assert effects_tables.ENUM.search((CHECKOUT / "schemas" / "patch.schema.json").read_text())


def test_every_effect_has_a_place_at_each_of_its_ports() -> None:
    schema = json.loads((CHECKOUT / "schemas" / "diagnosis.schema.json").read_text())
    known = schema["$defs"]["cause"]["properties"]["place"]["enum"]
    assert known == list(get_args(Place))
    for effect in CATALOGUE.values():
        described = effect.description
        assert set(described.places) <= set(described.ports)
        assert {described.place(port) for port in described.ports} <= set(known)
        # Two ports of an effect are two places: a finer word that does not tell them apart is none.
        assert len({described.place(port) for port in described.ports}) == len(described.ports)
