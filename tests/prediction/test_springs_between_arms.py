# SPDX-License-Identifier: BSD-3-Clause
"""Springs between arms in predictions: rests, displacements, stability, what hands feel of each other, the object."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.prediction.analysis_json import analysis_json
from impedance_modules.prediction.loop_stability import forecast_stability
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Loads, analyse_state, find_rest
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task_reader import read_task
from tests.support.paths import CHECKOUT

TASK = (CHECKOUT / "tasks" / "any-robot" / "lead-and-follow.yaml").read_text()
STIFFNESS = "stiffness: {x: 200, y: 200, z: 200, rx: 8, ry: 8, rz: 8}"
BOX = "object: {held_by: [right, left], shape: box, mass: 1, size: [0.3, 0.5, 0.1]}\n"


def assembled(folder: Path, text: str = TASK, **options: object) -> Assembly:
    """From a file, as a user has it."""
    path = folder / "task.yaml"
    path.write_text(text)
    return assemble(str(path), **{"effects": None, "rate": None, "scale": 1.0, "arm": None, **options})


def stretched(assembly: Assembly) -> tuple[Mechanism, Setting]:
    """The arms at the start with the spring between them relaxed 4 cm further apart and turned by 0.2 rad."""
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros(assembly.model.n))
    start, rest = start_equilibrium(modules), modules.between[0].start
    away = np.array([0.01, 0.04, 0.0])
    turned = Pose(exp3(np.array([0.0, 0.0, 0.2])), rest.translation + away)
    targets = replace(start, springs={**start.springs, "grip": turned})
    return mechanism, Setting(modules, targets, phase_damping(modules, mechanism.kinematics))


def test_coupling_of_hands_is_what_displacements_of_rests_show(tmp_path: Path) -> None:
    """Push both hands a little and find the new rest: wrench = K displacement, both hands at once."""
    mechanism, setting = stretched(assembled(tmp_path))
    hands = [arm.limb.hand for arm in setting.modules.arms]
    rest = find_rest(mechanism, setting, setting.modules.posture)
    assert rest is not None
    (group,) = analyse_state(mechanism, setting, rest.q).coupled
    assert group.limbs == ("right", "left") and not group.folds
    random = np.random.default_rng(1)
    for _ in range(3):
        push = random.normal(size=(2, 6)) * [1, 1, 1, 0.05, 0.05, 0.05]
        ends = []
        for sign in (1e-2, -1e-2):
            loads = Loads(dict(zip(hands, sign * push, strict=True)), False)
            found = find_rest(mechanism, setting, rest.q, loads)
            assert found is not None
            mechanism.update(found.q, np.zeros_like(found.q))
            ends.append([mechanism.kinematics.pose(hand) for hand in hands])
        moved = np.concatenate(
            [
                np.r_[a.translation - b.translation, _turn(a.rotation @ b.rotation.T)]
                for a, b in zip(*ends, strict=True)
            ]
        )
        np.testing.assert_allclose(group.stiffness @ moved, 2e-2 * push.ravel(), rtol=1e-3, atol=2e-5)


def _turn(rotation: np.ndarray) -> np.ndarray:
    return 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )


def test_both_arms_are_one_loop_that_a_stiff_spring_between_them_makes_unstable(tmp_path: Path) -> None:
    growths = []
    for name, words in (("soft", STIFFNESS), ("stiff", "stiffness: {x: 9000, y: 9000, z: 9000}")):
        (tmp_path / name).mkdir()
        assembly = assembled(tmp_path / name, TASK.replace(STIFFNESS, words))
        mechanism, modules = Mechanism(assembly), assembly.modules
        mechanism.update(modules.posture, np.zeros(assembly.model.n))
        damping = phase_damping(modules, mechanism.kinematics)
        state = analyse_state(
            mechanism, Setting(modules, start_equilibrium(modules), damping), modules.posture
        )
        (loop,) = forecast_stability(assembly, modules, state.arms, state.held, state.coupled)
        assert loop.name == "right and left"
        growths.append(loop.oscillating_growth)
    assert growths[0] < 1.0 < growths[1]


def test_analyze_tells_spring_and_coupling(tmp_path: Path) -> None:
    found = analyse_task(assembled(tmp_path), None)
    told = json.loads(json.dumps(analysis_json(found)))
    (spring,), (group,) = told["between"], told["coupled"]
    assert spring["name"] == "grip" and spring["frames"] == ["left_hand", "right_hand"]
    assert np.diag(spring["stiffness"]).tolist() == [200, 200, 200, 8, 8, 8] and spring["energy"] < 1e-12
    across = np.array(group["stiffness"]["left"]["right"])
    np.testing.assert_allclose(np.diag(across)[:3], -200.0, rtol=0.01)
    np.testing.assert_allclose(across, np.array(group["stiffness"]["right"]["left"]).T, atol=1e-6)
    alone = np.array(told["arms"]["left"]["stiffness"])
    np.testing.assert_allclose(alone, np.array(group["stiffness"]["left"]["left"]), atol=1e-5)


def test_between_the_hands_of_one_object_it_adds_nothing_but_an_internal_force(tmp_path: Path) -> None:
    spring_on_left = TASK.replace(
        "    joint_bias: {stiffness_per_effort: 0.01, damping_ratio: 0.7}\n",
        "    joint_bias: {stiffness_per_effort: 0.01, damping_ratio: 0.7}\n    springs: [{name: hand, frame: hand,"
        " expressed_in: world, stiffness: {x: 200, y: 200, z: 200, rx: 5, ry: 5, rz: 5}, damping_ratio: 0.4}]\n",
    )
    held = spring_on_left.replace("between:\n", BOX + "between:\n")
    held = held[: held.index("phases:")] + "phases:\n  - {name: wait, duration: 1}\n"
    without = held[: held.index("between:")] + held[held.index("safety:") :]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, other = (analyse_task(assembled(tmp_path / d, t), None) for d, t in (("a", held), ("b", without)))
    assert one.object is not None and other.object is not None and one.sum is not None
    scale = np.abs(other.object.stiffness).max()
    np.testing.assert_allclose(one.object.stiffness, other.object.stiffness, atol=1e-6 * scale)
    np.testing.assert_allclose(
        one.object.damping, other.object.damping, atol=1e-6 * np.abs(other.object.damping).max()
    )
    added = one.sum.summands["stiffness"].more["between"]
    assert added is not None and np.abs(added).max() > 100.0
    (tmp_path / "c").mkdir()
    pressed = analyse_task(
        assembled(
            tmp_path / "c",
            held.replace("damping_ratio: 0.7\nsafety", "damping_ratio: 0.7\n    rest: {y: 0.4}\nsafety"),
        ),
        None,
    )
    assert pressed.sum is not None
    assert pressed.sum.squeeze == pytest.approx(200.0 * 0.1, rel=0.05)


def test_one_arm_is_refused_and_so_is_a_link_on_another_robot(tmp_path: Path) -> None:
    with pytest.raises(
        BadInput, match="the spring 'grip' of task 'lead-and-follow' is between 'left' and 'right'"
    ):
        assembled(tmp_path, arm="right")
    text = TASK.replace("[left.hand, right.hand]", "[left.left_lower_forearm, right.hand]")
    (tmp_path / "tied.yaml").write_text(text)
    with pytest.raises(BadFile, match=r"between\[0\]\.frames\[0\]: names the link 'left_lower_forearm'"):
        read_task(tmp_path / "tied.yaml", robot="fr3-pair")


def test_a_scale_makes_it_softer(tmp_path: Path) -> None:
    soft = assembled(tmp_path, scale=0.25).modules.between[0].spec
    assert np.diag(soft.stiffness).tolist() == [50, 50, 50, 2, 2, 2]
    assert soft.damping_ratio == pytest.approx(0.35)
