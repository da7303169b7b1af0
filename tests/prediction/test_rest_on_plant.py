# SPDX-License-Identifier: BSD-3-Clause
"""Rest on the thesis's terrain: the predicted one, and where the noisy plant comes to rest."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.held_by_friction import held_by_friction
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import PredictedPhase, predict_motion
from impedance_modules.prediction.statics import SURROUNDINGS, Loads, Rest, find_rest
from tests.support.forecast_tasks import assembled, write_task
from tests.support.paths import CHECKOUT
from tests.support.shipped_runs import Watched, watch

HAND = "right_hand"
TERRAIN = (CHECKOUT / "tasks" / "thesis" / "slide-over.yaml").read_text()
SOFT = "stiffness: {s0: 0.005, s1: 5, e0: 5, e1: 0.005, w0: 0.005, w1: 5, w2: 5}"
SETTLES = "stiffness: {s0: 2, s1: 5, e0: 5, e1: 2, w0: 2, w1: 5, w2: 5}"
SHORT = (
    ("{z: -0.31}}, duration: 3}", "{z: -0.31}}, duration: 1.5}"),
    ("{z: -0.54}}, duration: 3}", "{z: -0.54}}, duration: 1.5}"),
    ("{y: -0.06}}, duration: 5}", "{y: -0.06}}, duration: 3}"),
    ("{name: stay, duration: 0.5}", "{name: stay, duration: 3}"),
    ("initial: 5.8, max: 10", "initial: 20, max: 40"),
)


STAY = 3
"""Index of the phase in which the hand leans on the block and its equilibria stand still."""


def rest_of(assembly: Assembly, phase: PredictedPhase, loads: Loads = SURROUNDINGS) -> Rest:
    rest = find_rest(Mechanism(assembly), phase.setting, phase.q, loads)
    assert rest is not None
    return rest


def settled(run: Watched, name: str) -> np.ndarray:
    """The mean of the last half second of the phase ``stay``."""
    return np.asarray(np.mean(run.seen(name, "stay")[-50:], axis=0))


def test_the_plant_comes_to_rest_where_predicted(tmp_path: Path) -> None:
    """On smooth surfaces, with joint springs that settle within seconds: joints, hand and force of the sheet."""
    changes = (
        *SHORT,
        (SOFT, SETTLES),
        ("friction: 0.2", "friction: 0"),
        ("stay, duration: 3", "stay, duration: 6"),
    )
    path = write_task(tmp_path, TERRAIN, *changes)
    assembly = assembled(path)
    phase = predict_motion(assembly).phases[STAY]
    mechanism, rest = Mechanism(assembly), rest_of(assembly, phase)
    run = watch(path, duration=12.0)
    q = settled(run, "q")
    assert np.max(np.abs(q - assembly.modules.posture)) > 0.3
    np.testing.assert_allclose(q[mechanism.joints], rest.q[mechanism.joints], atol=3e-4)
    mechanism.update(rest.q, np.zeros_like(rest.q))
    place = mechanism.kinematics.pose(HAND).translation
    np.testing.assert_allclose(settled(run, f"at {HAND}"), place, atol=2e-4)
    np.testing.assert_allclose(settled(run, f"surface on {HAND}"), rest.pressure[HAND][:3], atol=0.05)


def test_on_rough_surfaces_the_plant_rests_short_of_it_by_its_friction(tmp_path: Path) -> None:
    """Pushed by the friction that the plant's sheet exerts, the statics put the hand where the plant's is."""
    path = write_task(tmp_path, TERRAIN, *SHORT)
    assembly = assembled(path)
    phase = predict_motion(assembly).phases[STAY]
    run, mechanism = watch(path, duration=9.0), Mechanism(assembly)
    mechanism.update(settled(run, "q"), np.zeros(assembly.model.n))
    ((contact, _),) = mechanism.contacts(0.0)
    force = settled(run, f"surface on {HAND}")
    press = float(contact.normal @ force)
    friction = force - press * contact.normal
    assert 0.5 * press * 0.2 < np.linalg.norm(friction) < 1.02 * press * 0.2
    stuck = Loads({HAND: np.concatenate([friction, np.zeros(3)])}, surfaces=True)
    away = []
    for loads in (SURROUNDINGS, stuck):
        mechanism.update(rest_of(assembly, phase, loads).q, np.zeros(assembly.model.n))
        away.append(
            float(np.linalg.norm(mechanism.kinematics.pose(HAND).translation - settled(run, f"at {HAND}")))
        )
    assert away[0] > 5e-3 and away[1] < 1e-3


def test_the_plant_stops_where_friction_is_predicted_to_hold_it(tmp_path: Path) -> None:
    """On the table, on the way and on the block, at the end of three phases of the shipped speeds."""
    path = CHECKOUT / "tasks" / "thesis" / "slide-over.yaml"
    assembly, run = assembled(path), watch(path, duration=11.4)
    model = assembly.model
    for phase in predict_motion(assembly).phases[1:4]:
        rest = rest_of(assembly, phase)
        found = held_by_friction(Mechanism(assembly), phase.setting, rest, phase.q, HAND)
        assert found is not None
        press = rest.pressure[HAND][:3]
        assert found.force == pytest.approx(0.2 * np.linalg.norm(press), rel=0.05)
        place = run.seen(f"at {HAND}", phase.name)[-1]
        assert np.linalg.norm(found.position - place) < 2.5e-3
        if phase.name != "lean":
            assert np.linalg.norm(model.pose(rest.q, HAND).translation - place) > 0.01
