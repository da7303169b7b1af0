# SPDX-License-Identifier: BSD-3-Clause
"""What is fitted within priors is no finding, but it is said: a mass in the hand, and readings that are late."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.diagnosis.data.nominal_model import model_of_urdf
from impedance_modules.diagnosis.model_selection.swallowed import outermost
from impedance_modules.diagnosis.report.sentences import swallowed_sentences
from tests.diagnosis.test_diagnosis import JOINTS, URDF, answer, motion, torque
from tests.support.recordings import columns_of, save

MASS, REACH = 0.03, 0.15
"""One stated deviation of the fore arm's mass, at its centre [kg, m]."""


def hidden(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Torque of a small mass at the fore arm's centre: the difference of two double pendulums, by Lagrange."""
    length = 0.4
    cosine, sine, both = np.cos(q[:, 1]), np.sin(q[:, 1]), np.sin(q.sum(axis=1))
    M12 = REACH**2 + length * REACH * cosine
    M11 = length**2 + M12 + length * REACH * cosine
    turn = length * REACH * sine
    first = M11 * a[:, 0] + M12 * a[:, 1] - turn * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    second = M12 * a[:, 0] + REACH**2 * a[:, 1] + turn * v[:, 0] ** 2
    weight = np.column_stack([length * np.sin(q[:, 0]) + REACH * both, REACH * both])
    return MASS * (np.column_stack([first, second]) + 9.81 * weight)


def recorded(folder: Path, *, mass: bool = False, late: float = 0.0) -> list[Path]:
    paths = []
    for index, kind in enumerate((0, 0, 1, 2)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        tau = torque(q, v, a, mass=1.0) + (hidden(q, v, a) if mass else 0.0)
        tau = tau - late * np.gradient(tau, t, axis=0) + dice.normal(scale=0.01, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        columns = columns_of(t, JOINTS, position=q, effort=tau)
        paths.append(save(folder, f"run{index}", columns, repeat_of="run0" if index == 1 else None))
    return paths


def test_a_mass_within_the_links_deviation_is_said(tmp_path):
    code, found = answer(
        tmp_path, recorded(tmp_path, mass=True), "--without", "payload", "--without", "link_inertia"
    )
    swallowed = found["swallowed"]
    assert code == 0 and found["causes"] == []
    assert swallowed["hand"]["link"] == "fore" and swallowed["hand"]["share"] > 0.8
    assert swallowed["hand"]["mass"] == pytest.approx(MASS, rel=0.25)
    assert max(link["deviations"] for link in swallowed["links"].values()) > 0.5


def test_readings_that_are_a_little_late_are_said(tmp_path):
    _, found = answer(tmp_path, recorded(tmp_path, late=8e-4))
    late = found["swallowed"]["times"]["efforts"]
    assert late["later"] == pytest.approx(8e-4, rel=0.25) and late["unit"] == "s"
    assert late["deviations"] == pytest.approx(abs(late["later"]) / 1e-3, rel=1e-6)  # a tenth of 10 ms


def test_a_robot_that_carries_its_weight_by_old_positions_is_said(tmp_path):
    old, paths = 4e-3, []
    for index, kind in enumerate((0, 0, 1, 2)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        still = np.zeros_like(q)
        command = torque(q, v, a, mass=1.0) - torque(q - old * v, still, still, mass=1.0)
        columns = columns_of(
            t,
            JOINTS,
            position=q + dice.normal(scale=1e-5, size=q.shape),
            effort_command=command + dice.normal(scale=0.01, size=q.shape),
        )
        repeated = "run0" if index == 1 else None
        paths.append(save(tmp_path, f"run{index}", columns, repeat_of=repeated, gravity_compensation="robot"))
    _, found = answer(tmp_path, paths)
    late = found["swallowed"]["times"]["positions of compensated weights"]
    assert found["causes"] == [] and late["later"] == pytest.approx(old, rel=0.25)
    assert late["deviations"] == pytest.approx(late["later"] / 3e-3, rel=1e-6)


def test_where_nothing_was_swallowed_nothing_is_said(tmp_path):
    _, found = answer(tmp_path, recorded(tmp_path))
    assert swallowed_sentences(found["swallowed"]) == []
    assert swallowed_sentences(None) == []


def test_sentences_name_links_the_mass_in_the_hand_weights_and_stamps():
    link = {"mass": -0.04, "unit": "kg", "deviations": 2.1}
    hand = {"link": "tip", "mass": 0.15, "unit": "kg", "share": 0.95}
    times = {"commands": {"later": -4e-4, "unit": "s", "deviations": 1.3}}
    said = swallowed_sentences(
        {"links": {"fore": link}, "weights": {"deviations": 1.5}, "times": times, "hand": hand}
    )
    assert said == [
        "links other than stated by up to 2.1 of their stated deviation, most 'fore' (0.04 kg lighter)",
        "0.15 kg more at 'tip' would do the same",
        "weights that the robot compensates, other than stated by up to 1.5 of their stated deviation",
        "commands stamped 0.4 ms earlier (1.3 deviations)",
    ]


def test_a_link_whose_mass_is_as_stated_is_called_neither_heavier_nor_lighter():
    nothing = {"weights": {"deviations": 0.0}, "times": {}, "hand": None}
    said = swallowed_sentences(
        {"links": {"fore": {"mass": -1e-9, "unit": "kg", "deviations": 2.1}}, **nothing}
    )
    assert said == ["links other than stated by up to 2.1 of their stated deviation, most 'fore'"]


def test_the_outermost_body_has_most_joints_before_it(tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    assert outermost(model_of_urdf(tmp_path / "robot.urdf", JOINTS).tree) == 1
