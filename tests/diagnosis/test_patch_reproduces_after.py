# SPDX-License-Identifier: BSD-3-Clause
"""A cause's numbers, written as a patch and applied, leave of the same recording what the diagnosis claimed.

``after`` of a diagnosis is the residual less the cause's columns times their coefficients (and the nuisance within its
prior, which a patch does not have). Here the columns of every effect are taken at every port, at every kind of
recorded torque, on robots of one to fourteen recorded joints; their numbers go into a patch by the code that writes
it, are read back, and are applied to the model by the code of ``diagnose --effects``. The residual that remains, its
``before``, must be the ``after`` of the first.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml

from benchmarks.probe_pairs.pairs import TRUTHS
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel, model_of_spec, with_known_effects
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.diagnose import insufficient
from impedance_modules.diagnosis.report.diagnosis_files import patch_object, patch_text, why_no_patch
from impedance_modules.diagnosis.residuals.band import choose_band
from impedance_modules.diagnosis.residuals.preparation import Prepared, prepare
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.regressor import PAIR, Site
from impedance_modules.spec.patch_file import EffectSpec, read_patch
from impedance_modules.spec.robot_reader import read_robot

SPEC = read_robot("baxter")
ARM = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
JOINTS = tuple(f"{side}_{name}" for side in ("right", "left") for name in ARM)
COUNTS = (1, 2, *(pytest.param(count, marks=pytest.mark.long) for count in (7, 14)))
RATE, SECONDS = 50.0, 8.0
SENSORS = ("joint_sensor", "motor", "none")
"""Where torques were measured; ``none``: commands alone."""

NUMBERS = {truth.effect: truth.numbers for truth in reversed(TRUTHS)}
CASES = [
    (effect.id, port)
    for effect in CATALOGUE.values()
    if effect.searched
    not in ("in_contact", "while_held")  # its patch changes the task, not the robot's model
    for port in effect.description.ports
]
BEHIND, STIFF = ("joint_elasticity", "sensor"), {"K": 20000.0}
"""A spring before an encoder at the motor, so stiff that what its deflection costs is in proportion to 1 / K."""

NONLINEAR = {BEHIND: 0.1}
"""Where the columns are a linearisation of what the model then computes; of all others a millionth may be left."""


@cache
def model_of(count: int, rigid_joints: bool) -> tuple[NominalModel, BatchedRigidModel]:
    """The model; with rigid joints nobody says on which side of their gears the encoders sit.

    Its springs have no damping of their own: a cause with another stiffness has no column for what that damping, whose
    time D / K changes with it, hides from the effort sensor.
    """
    model = replace(model_of_spec(SPEC, list(JOINTS[:count])), spring_damping=np.zeros(count))
    if rigid_joints:
        model = replace(model, encoders=(None,) * count, compliance=np.zeros(count))
    return model, BatchedRigidModel.of_tree(SPEC.urdf, model.tree)


@cache
def log_of(count: int, sensor: str) -> Log:
    """Three tones per joint about a posture; torques that no effect of a model has to explain."""
    random = np.random.default_rng(count)
    time = np.arange(round(SECONDS * RATE)) / RATE
    tones, phases = random.uniform(0.1, 0.8, (3, count)), random.uniform(0.0, 2.0 * np.pi, (3, count))
    position = np.sum(0.25 * np.sin(2.0 * np.pi * tones * time[:, None, None] + phases), axis=1)
    torque = 8.0 * np.sum(np.sin(2.0 * np.pi * 0.7 * tones * time[:, None, None] + phases), axis=1)
    return Log(
        name="run",
        group="run",
        rate=RATE,
        position=position,
        velocity=np.gradient(position, time, axis=0),
        effort=None if sensor == "none" else torque,
        command=1.1 * torque,
        position_command=position + 0.01 * torque,
        effort_source=None if sensor == "none" else sensor,
        gravity_compensation="robot",
    )


@cache
def nominal(count: int, sensor: str, rigid_joints: bool) -> Prepared:
    log = log_of(count, sensor)
    return prepare(log, *model_of(count, rigid_joints), choose_band([log]))


def carrier(effect: str, model: NominalModel) -> tuple[str, tuple[str, ...]] | None:
    """Key and joints of an effect on the last recorded joint; None for a pair where one joint was recorded."""
    kinds, joint = CATALOGUE[effect].description.keys, model.joints[-1]
    if "joint" in kinds:
        return joint, (joint,)
    if "body" in kinds:
        return next(body.link for body in model.tree.bodies if body.joint == joint), ()
    if "pair" in kinds:
        return None if len(model.joints) == 1 else (f"{joint}{PAIR}{model.joints[-2]}", (joint,))
    return kinds[0], ()


def diagnosis_with(cause: Cause) -> Diagnosis:
    return replace(insufficient("baxter", ["run"], ""), verdict="explained", causes=(cause,))


def applied(effect: str, port: str, key: str, joints: tuple[str, ...], values: dict, folder) -> EffectSpec:
    """The cause as ``--patch`` writes it and ``--effects`` reads it."""
    described = CATALOGUE[effect].description
    numbers = {key: {s: Estimate(v, 0.01, described.parameter(s).unit) for s, v in values.items()}}
    cause = Cause(effect, joints, port, numbers, 1.0, 0.9, (), (), {}, {})
    path = folder / "found.yaml"
    path.write_text(patch_text(patch_object(diagnosis_with(cause))))
    assert yaml.safe_load(path.read_text())["effects"]
    return read_patch(path).effects[0]


def left_in_two_ways(
    effect: str, port: str, key: str, joints: tuple[str, ...], first: Prepared, again
) -> list[tuple[str, float, float]]:
    """Residual, rms of what the cause took from it, and of the difference of ``before`` and ``after``."""
    law, site = CATALOGUE[effect], Site(first.signals, key, port)
    coefficients, shape = law.coefficients(STIFF if (effect, port) == BEHIND else NUMBERS[effect], site)
    second = again(law.values(coefficients, shape, site))
    out = []
    for residual, before in first.residuals.items():
        found = law.regressor(site, residual, shape)
        took = np.zeros((first.signals.samples, first.signals.n))
        if found is not None:
            took[:, list(found.rows)] = found.torque(coefficients)
        after = before - first.band.condense(took)
        rms = [float(np.sqrt(np.mean(x**2))) for x in (before - after, second.residuals[residual] - after)]
        out.append((residual, *rms))
    return out


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize(("effect", "port"), CASES)
def test_the_patch_leaves_what_the_diagnosis_claimed(
    effect: str, port: str, sensor: str, count: int, tmp_path
) -> None:
    rigid_joints = port == "sensor" and CATALOGUE[effect].encoder_side("sensor") is not None
    (model, rigid), log = model_of(count, rigid_joints), log_of(count, sensor)
    band, found = choose_band([log]), carrier(effect, model)
    if found is None:
        return
    key, joints = found

    def again(values: dict[str, float]) -> Prepared:
        patched, adding = with_known_effects(model, [applied(effect, port, key, joints, values, tmp_path)])
        return prepare(log, patched, rigid, band, adding)

    first = nominal(count, sensor, rigid_joints)
    allowed = NONLINEAR.get((effect, port), 1e-6)
    found = left_in_two_ways(effect, port, key, joints, first, again)
    most = max(took for _, took, _ in found)
    for residual, took, differs in found:
        assert differs <= allowed * most + 1e-9, f"{residual}: took {took:.3g}, differs by {differs:.3g}"


def named(effect: str, shrink: float | None, port: str = "link") -> Cause:
    numbers = {"right_w0": {"c": Estimate(0.1, 0.01, "N.m")}}
    return Cause(effect, ("right_w0",), port, numbers, 0.5, shrink, (), (), {}, {})


@pytest.mark.parametrize(("together", "kept"), [(0.9, 2), (0.001, 2), (0.0, 1), (-0.1, 1), (None, 1)])
def test_what_helps_beside_the_others_is_in_the_patch(together: float | None, kept: int) -> None:
    """A small cause beside a loud joint's, or two that act against each other, shrink little or nothing alone."""
    causes = (named("torque_offset", 0.5), named("viscous_friction", -0.4))
    found = replace(diagnosis_with(causes[0]), causes=causes, shrink=together)
    assert len(patch_object(found)["effects"]) == kept


def test_where_there_is_no_patch_the_reason_is_said() -> None:
    push, useless = named("external_contact", None, "contact"), named("torque_offset", -0.01)
    pushed = replace(diagnosis_with(push), shrink=0.9)
    assert patch_object(pushed) is None and "no property of the robot" in why_no_patch(pushed)
    unhelpful = diagnosis_with(useless)
    assert patch_object(unhelpful) is None and why_no_patch(unhelpful) == "no effect shrank the held-out gap"
    nothing = replace(unhelpful, causes=(), verdict="unexplained")
    assert patch_object(nothing) is None and "the verdict is unexplained" in why_no_patch(nothing)
