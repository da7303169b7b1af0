# SPDX-License-Identifier: BSD-3-Clause
"""`impedance tune`: the least joint springs hold, a little less folds, by the formula and on the plant."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_experiments.task_run import watch_task
from impedance_modules.superposition.net_stiffness import net_stiffness
from impedance_modules.tools.spring_tuning import MARGIN, TuningRequest, folding_share, least_stiffness, tune
from tests.support.commands import invoke, refusal
from tests.support.forecast_tasks import assembled

DOWN = np.array([0.0, 0.0, -1.0])
PRESS = TuningRequest("right", DOWN, 0.0, 25.0, postures=1, reach=2.0, softest=0.5, alone=True)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_no_joint_springs_of_a_smaller_sum_hold_any_load(seed: int) -> None:
    """Random symmetric loads: the answer holds, stands on its bound, and no random rival beats it."""
    random = np.random.default_rng(seed)
    k = int(random.integers(1, 8))
    loads = [(m + m.T) * 5.0 for m in random.normal(size=(int(random.integers(1, 3)), k, k))]
    least = random.uniform(0.1, 2.0, k)
    found = least_stiffness(loads, least, 1e4)
    assert np.all(found >= least - 1e-9)
    share = folding_share(found, loads)
    assert share < 1.0 + 1e-6
    assert share > 1.0 - 1e-3 or np.isclose(found.sum(), least.sum())
    for rival in least + random.exponential(found.mean(), (200, k)):
        if rival.sum() < 0.999 * found.sum():
            assert folding_share(rival, loads) > 1.0


def test_more_force_needs_stiffer_joints_and_no_force_none() -> None:
    assembly = assembled("wipe-table")
    sums = [tune(assembly, replace(PRESS, high=high)).best.total for high in (1.0, 10.0, 20.0, 30.0)]
    assert sums == sorted(sums) and sums[-1] > 10.0 * sums[0]
    with_springs = tune(assembly, replace(PRESS, alone=False)).best
    assert with_springs.total < 0.5 * tune(assembly, PRESS).best.total


def test_the_answer_does_not_fold_and_five_per_cent_less_does() -> None:
    """Judged by the net stiffness of design 4, which shares nothing but Gamma with the search."""
    assembly = assembled("wipe-table")
    tuned = tune(assembly, PRESS).best
    model, limb = assembly.model, assembly.model.limbs["right"]
    data, hand = model.pin_model.createData(), model.frame_id(limb.hand)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(model.pin_model, data, tuned.posture.q, hand, axes)[:, limb.joints]
    for force in (0.0, 10.0, 25.0):
        load = np.append(-force * DOWN, np.zeros(3))
        for share, folds in ((1.0, False), (0.95, force == 25.0)):
            assert net_stiffness(J, share * tuned.stiffness, np.zeros((6, 6)), load).folds == folds
    assert tuned.folds_at == pytest.approx(1.0 / MARGIN, rel=1e-3)


def test_another_elbow_needs_less() -> None:
    assembly = assembled("wipe-table")
    tuning = tune(assembly, replace(PRESS, postures=4))
    limb = assembly.model.limbs["right"]
    hand = assembly.model.pose(assembly.modules.posture, limb.hand)
    assert len(tuning.found) >= 3
    for tuned in tuning.found:
        pose = assembly.model.pose(tuned.posture.q, limb.hand)
        np.testing.assert_allclose(pose.translation, hand.translation, atol=1e-7)
        np.testing.assert_allclose(pose.rotation, hand.rotation, atol=1e-7)
    own = next(tuned for tuned in tuning.found if tuned.posture.along == 0.0)
    assert tuning.best.total < 0.9 * own.total


def test_the_arm_holds_and_five_per_cent_softer_it_folds_on_the_plant(tmp_path: Path) -> None:
    """The posture is an equilibrium all along: what is away from it dies out, or grows."""
    away = {}
    for share in ("1", "0.95"):
        trial = tmp_path / f"{share}.yaml"
        words = ("wipe-table", "--force", "0:25", "--direction=-z", "--alone", "--reach", 2, "--postures", 4)
        assert "5 % less does" in invoke("tune", *words, "--share", share, "--trial", trial).output
        text = trial.read_text()
        for long, short in (("duration: 3.0", "duration: 1.5"), ("rise: 3.0", "rise: 1.5"), ("12.0", "3.0")):
            text = text.replace(long, short)
        trial.write_text(text)
        assembly, path = assembled(trial), []
        start = assembly.modules.posture.copy()

        def look(_state, plant, _supervisor, path=path, start=start) -> None:
            path.append(np.linalg.norm(plant.position - start))

        watch_task(assembly, look)
        away[share] = path
    early, late = 2000, -1
    assert away["1"][late] < 0.97 * away["1"][early]
    assert away["0.95"][late] > 1.04 * away["0.95"][early]


def test_what_is_written_is_a_task_that_check_accepts(tmp_path: Path) -> None:
    out, answer = tmp_path / "tuned.yaml", tmp_path / "tuned.json"
    words = ("wipe-table", "--force", "0:15", "--direction", "0,0,-2", "--postures", 3)
    invoke("tune", *words, "--out", out, "--json", answer)
    assert "valid" in invoke("check", out).output
    best = json.loads(answer.read_text())["best"]
    arm = yaml.safe_load(out.read_text())["arms"]["right"]
    for name, joint in best["joints"].items():
        short = name.removeprefix("right_")
        assert arm["posture"][short] == pytest.approx(joint["posture"], abs=1e-6)
        assert arm["joint_bias"]["stiffness"][short] == pytest.approx(joint["stiffness"], abs=1e-5)
    shipped = yaml.safe_load(Path("tasks/wipe-table.yaml").read_text())
    assert arm["springs"] == shipped["arms"]["right"]["springs"]


WIPE, DOWNWARDS, ALONG = "wipe-table", "--direction=-z", ("--force", "0:5", "--direction", "x")
REFUSED = {
    "force": ((WIPE, "--force", "25", DOWNWARDS), "LO:HI in N"),
    "range": ((WIPE, "--force", "9:3", DOWNWARDS), "LO not above HI"),
    "direction": ((WIPE, "--force", "0:5", "--direction", "down"), "x, -z"),
    "no length": ((WIPE, "--force", "0:5", "--direction", "0,0,0"), "no length"),
    "arm": (("soft-hold", *ALONG), "--arm is missing"),
    "no arm": (("soft-hold", "--arm", "rigth", *ALONG), "did you mean 'right'?"),
    "mirror": (
        ("mirrored-arms", "--arm", "left", *ALONG, "--out", "never.yaml"),
        "the mirror image of 'right'",
    ),
    "object": (("box-hold", "--arm", "right", *ALONG), "holds an object"),
    "too much": ((WIPE, "--force", "0:900", DOWNWARDS, "--postures", "1"), "valid: up to"),
    "reach": ((WIPE, "--force", "0:5", DOWNWARDS, "--reach", "0"), "above 0"),
    "softest": ((WIPE, "--force", "0:5", DOWNWARDS, "--softest", "0"), "above 0"),
    "postures": ((WIPE, "--force", "0:5", DOWNWARDS, "--postures", "0"), "1 to 200"),
    "share": ((WIPE, "--force", "0:5", DOWNWARDS, "--share", "0"), "above 0"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_question_is_told_what_would_be_valid(name: str) -> None:
    words, says = REFUSED[name]
    assert says in refusal("tune", *words)
    assert not Path("never.yaml").exists()
