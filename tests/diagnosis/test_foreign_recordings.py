# SPDX-License-Identifier: BSD-3-Clause
"""What recordings of strangers bring along: planar arms, stamps that jitter, encoders' grids, one short motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.encoder_grid import quantisation_step
from impedance_modules.diagnosis.data.folds import FOLDS_MIN, assign_folds
from impedance_modules.diagnosis.data.stamps import sampling_times
from tests.diagnosis.test_diagnosis import JOINTS, answer, diagnosed, motion, torque
from tests.diagnosis.test_diagnosis_data import admitted, columns, diagnose, urdf  # noqa: F401
from tests.support.recordings import columns_of, save


def point(q, v, a, mass, reach, length=0.4, g=9.81):
    """Torque that a point mass on the second link needs, by Lagrange: (N, 2)."""
    cosine, sine, both = np.cos(q[:, 1]), np.sin(q[:, 1]), np.sin(q.sum(axis=1))
    M12 = reach**2 + length * reach * cosine
    M11 = length**2 + M12 + length * reach * cosine
    turn = length * reach * sine
    first = M11 * a[:, 0] + M12 * a[:, 1] - turn * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    second = M12 * a[:, 0] + reach**2 * a[:, 1] + turn * v[:, 0] ** 2
    weight = np.column_stack([length * np.sin(q[:, 0]) + reach * both, reach * both])
    return mass * (np.column_stack([first, second]) + g * weight)


def test_a_payload_of_a_planar_arm_is_named_although_its_width_is_not_observable(tmp_path):
    paths = []
    for index, kind in enumerate((0, 1, 2, 0)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        tau = torque(q, v, a, mass=1.0) + point(q, v, a, 0.3, 0.3)
        tau = tau + dice.normal(scale=0.02, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        paths.append(save(tmp_path, f"run{index}", columns_of(t, JOINTS, position=q, effort=tau)))
    code, found = answer(tmp_path, paths)
    first = found["causes"][0]
    body = first["parameters"]["fore"]
    assert (first["effect"], code) == ("payload", 0)
    assert body["m"]["value"] == pytest.approx(0.3, rel=0.1)
    assert body["cz"]["value"] == pytest.approx(-0.3, rel=0.1)
    assert body["cy"]["std"] > 0.3  # nothing was seen of it


@settings(max_examples=25, deadline=None)
@given(step=st.floats(1e-5, 5e-3), seed=st.integers(0, 99))
def test_a_quantisation_step_is_found_only_where_there_is_one(step, seed):
    dice = np.random.default_rng(seed)
    smooth = 0.7 * np.sin(np.linspace(0.0, 20.0, 4000)) + 1e-5 * dice.standard_normal(4000)
    assert quantisation_step(step * np.round(smooth / step)) == pytest.approx(step, rel=1e-3)
    assert quantisation_step(smooth) < 1e-8


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 99), size=st.floats(0.02, 0.08))
def test_stamps_are_used_only_if_the_motion_is_smooth_by_them(seed, size):
    dice = np.random.default_rng(seed)
    even = 0.01 * np.arange(800)
    true = even + 0.01 * size * dice.standard_normal(800)
    jittered = sampling_times(true, np.sin(3.0 * even)[:, None])  # sampled evenly, stamped unevenly
    assert np.abs(jittered - even).max() < 5e-4
    np.testing.assert_array_equal(sampling_times(true, np.sin(3.0 * true)[:, None]), true)


def test_the_held_out_motion_is_not_the_widest_and_not_a_matter_of_order(tmp_path, urdf):  # noqa: F811
    kinds = {"a": 0, "b": 1, "c": 2, "narrow": 3}
    paths = [save(tmp_path, name, columns(kind)) for name, kind in kinds.items()]
    logs, _ = admitted(urdf, *paths)
    wide = [replace(log, position=0.4 * log.position) if log.name == "narrow" else log for log in logs]
    dice = np.random.default_rng(1)
    chosen = set()
    for _ in range(6):
        found = assign_folds([wide[i] for i in dice.permutation(len(wide))], ())
        chosen.add(tuple(found.logs[i].name for i in found.heldout))
    assert len(chosen) == 1
    largest = max(wide, key=lambda log: float(np.ptp(log.position, axis=0).sum()))
    assert (largest.name,) not in chosen


@pytest.mark.parametrize("fast", [0.05, 0.4, 0.9])
def test_the_only_fast_stretch_of_a_motion_is_fitted(tmp_path, urdf, fast):  # noqa: F811
    """Held out it would show laws that no other segment shows."""
    (log,), _ = admitted(urdf, save(tmp_path, "a", columns(0, seconds=24.0)))
    time = np.arange(log.samples) / log.rate
    rush = ((time >= fast * time[-1]) & (time < (fast + 0.06) * time[-1])).astype(float)
    position = log.position.copy()
    position[:, 0] = np.cumsum((0.05 + rush) * np.cos(8.0 * time)) / log.rate
    found = assign_folds([replace(log, position=position)], ())
    speeds = [np.ptp(np.diff(part.position[:, 0])) for part in found.logs]
    assert max(speeds[i] for i in found.fitted) > 0.9 * max(speeds)


def test_one_recording_of_ten_seconds_is_enough(tmp_path, urdf):  # noqa: F811
    code, said = diagnose(urdf, save(tmp_path, "short", columns(0, seconds=10.0)))
    assert code == 0 and "no_gap" in said
    code, said = diagnose(urdf, save(tmp_path, "shorter", columns(0, seconds=3.0)))
    assert code == 7 and "too short to fit one part and test on another" in said and "valid:" in said


@pytest.mark.parametrize("names", [("a", "b"), ("b", "a")])
def test_of_two_recordings_the_one_too_short_to_be_cut_is_held_out(tmp_path, urdf, names):  # noqa: F811
    """More data is never too little: the long one alone is enough, also beside a short one that moves more."""
    paths = [
        save(tmp_path, name, columns(kind, seconds=seconds))
        for name, (kind, seconds) in zip(names, ((0, 10.0), (1, 3.0)), strict=True)
    ]
    (long, short), _ = admitted(urdf, *paths)
    found = assign_folds([replace(long, position=0.3 * long.position), short], ())
    assert [found.logs[i].name for i in found.heldout] == [names[1]]
    assert len(found.folds) >= FOLDS_MIN


def test_efforts_on_a_clock_of_their_own_are_told_in_short_recordings(tmp_path):
    """They come 45 ms late: a delay of each joint's command would leave the torque of the links late."""
    paths = []
    for kind in range(4):
        dice = np.random.default_rng(kind)
        t, q, v, a = motion(kind, 10.0)
        tau = torque(q, v, a, mass=1.0)
        late = np.column_stack([np.interp(t - 0.045, t, column) for column in tau.T])
        late += dice.normal(scale=0.02, size=tau.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        values = columns_of(t, JOINTS, position=q, effort=late, effort_command=tau)
        paths.append(save(tmp_path, f"run{kind}", values, effort_source="joint_sensor"))
    _, found = answer(tmp_path, paths)
    first = found["causes"][0]
    numbers = first["parameters"]["log"]
    assert first["effect"] == "clock_drift" and numbers["apart"]["value"] == 2.0
    late = numbers["T"]
    assert abs(late["value"] - 0.045) < 2.0 * late["std"] < 0.02


PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><mass value="0.5"/>
<origin xyz="0 0 -0.25"/><inertia ixx="0.01" iyy="0.01" izz="0.0002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.parametrize(("mass", "reach"), [(1.0, 0.5), (2.0, 0.5), (0.3, 0.8), (1.0, 1.2)])
def test_a_weight_on_a_pendulum_has_its_mass_and_its_place(tmp_path, mass, reach):
    """One joint shows m d and m d^2, and no mass: both numbers follow from these two wherever the search begins."""
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    paths = []
    for run in range(4):
        dice, noise = np.random.default_rng(min(run, 2)), np.random.default_rng(10 + run)
        t = np.arange(0.0, 15.0, 0.01)
        rate, size = 2.0 * np.pi * dice.uniform(0.2, 1.3, 4), dice.uniform(0.2, 0.6, 4)
        wave = size * np.sin(rate * t[:, None] + dice.uniform(0.0, 6.28, 4))
        q, a = wave.sum(axis=1), -(rate**2 * wave).sum(axis=1)
        inertia = 0.01 + 0.5 * 0.25**2 + mass * reach**2
        effort = (
            inertia * a + 9.81 * (0.5 * 0.25 + mass * reach) * np.sin(q) + noise.normal(0.0, 0.02, len(t))
        )
        data = columns_of(
            t, ["swing"], position=q[:, None] + 1e-5 * noise.normal(size=(len(t), 1)), effort=effort[:, None]
        )
        paths.append(save(tmp_path, f"run{run}", data, repeat_of="run2" if run == 3 else None))
    _, found = diagnosed(tmp_path, *paths, "--urdf", tmp_path / "pendulum.urdf")
    (cause,) = found["causes"]
    body = cause["parameters"]["rod"]
    assert cause["effect"] == "payload"
    assert body["m"]["value"] == pytest.approx(mass, rel=0.02)
    assert body["cz"]["value"] == pytest.approx(-reach, rel=0.02)
    assert 0.0 < body["m"]["std"] < 0.1 * mass
