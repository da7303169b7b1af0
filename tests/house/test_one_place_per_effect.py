# SPDX-License-Identifier: BSD-3-Clause
"""An effect has one place: its class and its line in the catalogue. No other file knows it by its id."""

from pathlib import Path

import numpy as np
import pytest

from docs import effects_tables
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.effects.catalogue import CATALOGUE, not_searched
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.effect_description import Description, Parameter
from impedance_modules.effects.joint_motion import JointSample, Shape
from impedance_modules.errors import BadFile
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, PatchSpec
from tests.house.test_imports import PACKAGE, literals
from tests.support.commands import invoke
from tests.support.effect_recordings import nominal, start
from tests.support.paths import CHECKOUT

SAME_WORD = {
    "reflected_inertia": {
        "spec",
        "new_robot",
        "robot",
        "plant",
        "prediction",
        "runs",
    },  # a joint's number in robot.yaml
    "added_mass": {"plant"},  # a column of the links' table
    "command_delay": {"spec"},  # a number of robot.yaml's timing
    "hysteresis": {"backends"},  # a field of Baxter's message SEAJointState
    "crosstalk": {"backends"},  # likewise
}
"""Words that are an effect's id and something else too: where they mean the other thing."""


def test_no_other_package_knows_an_effect_by_its_id() -> None:
    found = [
        f"{path.relative_to(CHECKOUT)}:{line}: '{value}'"
        for path in sorted(PACKAGE.rglob("*.py"))
        if (folder := path.relative_to(PACKAGE).parts[0]) != "effects"
        for line, value in literals(path)
        if value in CATALOGUE and folder not in SAME_WORD.get(value, set())
    ]
    assert not found, "ask an attribute of the effect instead of its id:\n" + "\n".join(found)


class CubicFriction(JointLaw):
    """c v^3, which the catalogue does not have."""

    description = Description(
        id="cubic_friction",
        sentence="A torque against the motion that grows with the cube of the speed.",
        equation="tau = c v^3",
        parameters=(Parameter("c", "N.m.s^3/rad^3", "friction", lower=0.0),),
        ports=("actuator", "link"),
        keys=("joint",),
        signature="strong curvature at high speed",
        confusable_with=("quadratic_drag",),
        excitation="several speeds up to the limit",
        reference="none: a test's own",
        applied="The plant, as a torque at the motor or at the link.",
    )

    def basis(self, sample: JointSample, shape: Shape) -> np.ndarray:
        """Computes v^3."""
        return (sample.velocity**3)[..., None]


@pytest.fixture
def cubic(monkeypatch: pytest.MonkeyPatch) -> CubicFriction:
    """A new effect: its class and its line in the catalogue, nothing else."""
    effect = CubicFriction()
    monkeypatch.setitem(CATALOGUE, effect.id, effect)
    return effect


def patch_with(effect: str, joint: str, unit: str) -> PatchSpec:
    numbers = {joint: {"c": PatchQuantity(0.8, unit, None)}}
    spec = EffectSpec(effect, (joint,), "link", numbers, {})
    return PatchSpec(nominal(0.0).name, (spec,), parse_document(Path("patch.yaml"), "format: 1\n"))


def test_a_new_effect_is_checked_applied_and_searched_for(cubic: CubicFriction) -> None:
    joint, robot = "port_lift", nominal(0.0)
    patch = patch_with(cubic.id, joint, "N.m.s^3/rad^3")
    model = RobotModel(apply_patch(robot, patch))
    options = PlantOptions(1000.0, 0, noise=False, step=0.5e-3)
    plant = Plant(model, [], None, options, apply_to_plant(model, patch))
    plant.reset(start(model))
    plant.advance(plant.start_command)
    assert cubic.id not in not_searched(under_water=False)


def test_a_new_effect_is_refused_in_a_wrong_unit(cubic: CubicFriction) -> None:
    with pytest.raises(BadFile, match=r"is in N\.m\.s\^3/rad\^3"):
        apply_patch(nominal(0.0), patch_with(cubic.id, "port_lift", "N.m"))


def test_a_new_effect_is_shown_and_documented(cubic: CubicFriction) -> None:
    assert cubic.description.sentence[:30] in invoke("effects", cubic.id).output
    texts = effects_tables.texts()
    assert "`cubic_friction`" in texts[CHECKOUT / "docs" / "effects.md"]
    assert '"cubic_friction"' in texts[CHECKOUT / "schemas" / "patch.schema.json"]
