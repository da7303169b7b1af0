# SPDX-License-Identifier: BSD-3-Clause
"""Loops that are unstable on the way only, and what a surface does to arms that begin inside it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.prediction.loop_stability import loop_growths
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.passages import LARGEST_AMPLIFICATION, _Amplitude, find_passages
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.prediction.statics import analyse_state, find_rest
from tests.support.commands import invoke, refusal
from tests.support.forecast_tasks import WIPE, assembled, wipe, write_task

DRIFTING = """
format: 1
name: drifting
robot: baxter
arms:
  left:
    posture: {s0: 1.1236, s1: -0.4743, e0: 2.9158, e1: 1.0062, w0: 2.9573, w1: 1.4048, w2: 2.4229}
    joint_bias:
      stiffness: {s0: 10.1, s1: 11.06, e0: 17.31, e1: 3.763, w0: 2.375, w1: 24.48, w2: 29.78}
      damping_ratio: 0.433
    springs:
      - name: hand
        frame: left_hand
        expressed_in: left_hand
        stiffness: {x: 57.66, z: 37.16, rx: 0.378, ry: 0.478, rz: 0.465}
        damping_ratio: 0.557
        axes: {y: {force: 15.27, speed_limit: 0.1119}}
safety: {tank: {initial: 5.1, max: 10.2, floor: 0.3}}
phases:
  - {name: drift, duration: SECONDS}
"""
"""A force without a spring against it: the arm's loop is unstable where it begins, and stable where it comes to rest
after a long way. At a rate of 320 Hz it shakes on the plant."""


def test_a_loop_that_is_unstable_on_the_way_is_refused_with_its_time(tmp_path: Path) -> None:
    path = write_task(tmp_path, DRIFTING, ("SECONDS", "2.0"))
    text = refusal("check", path, "--rate", 320.5)
    assert f"{path}:12:7: arms.left.springs" in text
    assert "unstable on the way" in text and "phase 'drift'" in text and "--allow-unstable" in text
    # Where the robot would stop before the swing has grown, and at a rate at which nothing grows, it is no harm.
    for seconds, rate in (("0.2", 320.5), ("2.0", 1000)):
        write_task(tmp_path, DRIFTING, ("SECONDS", seconds))
        assert "unstable" not in invoke("check", path, "--rate", rate).output


RUNAWAY = """
format: 1
name: runaway
robot: baxter
arms:
  right:
    posture: {s0: -0.0073, s1: -0.1951, e0: 1.1097, e1: 0.2439, w0: 2.6155, w1: 0.5389, w2: 1.3742}
    joint_bias:
      stiffness: {s0: 1.065, s1: 0.616, e0: 0.813, e1: 9.62, w0: 4.35, w1: 10.01, w2: 10.54}
      damping_ratio: 0.955
    springs:
      - name: hand
        frame: right_hand
        expressed_in: right_hand
        stiffness: {x: 1740.7, y: 1161.2, z: 2755.6, rx: 6.34, ry: 8.39, rz: 22.8}
        damping_ratio: 0.248
safety: {tank: {initial: 43, max: 86, floor: 0.3}}
phases:
  - name: go
    duration: 0.458
    equilibrium: {right.hand: {x: 0.0235, y: -0.1534, z: -0.1197}}
    posture: {right: {s0: -0.0205, s1: -0.1274, e0: 1.2523, w0: 2.9495, w2: 1.2077}}
  - {name: turn, duration: 0.55, equilibrium: {right.hand: {rx: {sine: {amplitude: 0.0102, frequency: 0.9368}}}}}
  - {name: stay, duration: 0.51}
"""


def test_a_motion_that_runs_away_is_refused_with_its_phase(tmp_path: Path) -> None:
    """Its numbers would end beyond any float, and the prediction with them."""
    text = refusal("check", write_task(tmp_path, RUNAWAY), "--rate", 357.7)
    assert (
        "phases[2]" in text and "runs away in phase 'stay'" in text and "times its speed limit at 1." in text
    )


def test_a_passage_tells_when_and_where_it_grows(tmp_path: Path) -> None:
    assembly = assembled(write_task(tmp_path, DRIFTING, ("SECONDS", "2.0")), rate=320.5)
    mechanism, motion = Mechanism(assembly), predict_motion(assembly)
    (found,) = find_passages(assembly, mechanism, motion)
    assert found.phase == 0 and 0.0 < found.time < 2.0
    phase = motion.phases[0]
    rest = find_rest(mechanism, phase.setting, phase.q)
    assert rest is not None
    for q, stable in ((found.fastest.q, False), (rest.q, True)):
        state = analyse_state(mechanism, phase.setting, q)
        growth = max(loop_growths(assembly, phase.modules, state.arms, state.held))
        assert (growth < 1.0) is stable


@given(st.lists(st.tuples(st.floats(0.9, 1.2), st.floats(0.0, 20.0)), min_size=1, max_size=20))
def test_a_swing_is_the_largest_product_of_growths_up_to_now(steps: list[tuple[float, float]]) -> None:
    amplitude, logs = _Amplitude(), []
    for growth, periods in steps:
        amplitude.go_on(growth, periods, None)
        logs.append(periods * math.log(growth))
        ends = [sum(logs[first:]) for first in range(len(logs))]
        assert math.log(amplitude.size) == pytest.approx(max(0.0, *ends), abs=1e-9)


def test_the_posture_at_which_it_grew_fastest_is_told() -> None:
    amplitude = _Amplitude()
    for number, growth in enumerate((1.01, 1.05, 1.02)):
        amplitude.go_on(growth, 10.0, number)
    assert amplitude.fastest == 1
    amplitude.go_on(0.5, 1e3, 3)
    amplitude.go_on(1.01, 10.0, 4)
    assert amplitude.fastest == 4


def test_a_swing_that_grows_without_bound_stays_a_number() -> None:
    amplitude = _Amplitude()
    for _ in range(5):
        amplitude.go_on(2.0, 1e6, None)
        assert amplitude.size > LARGEST_AMPLIFICATION
        amplitude.go_on(0.0, 1e6, None)
        assert amplitude.size == 1.0


def test_a_hand_that_begins_deep_inside_a_surface_is_refused(tmp_path: Path) -> None:
    free = assembled(write_task(tmp_path, WIPE, ("HEIGHT", "-1.0"), ("DEEP", "-0.9")))
    hand = float(free.modules.arms[0].springs[0].start.translation[2])
    text = refusal("check", write_task(tmp_path, WIPE, ("HEIGHT", f"{hand + 0.02}"), ("DEEP", "-0.9")))
    assert "environment[0]: the hand 'right_hand' begins 20 mm inside this surface" in text
    assert "400 N" in text and "whose limit is" in text
    # A gentle press at the start is none of its business.
    path = write_task(tmp_path, WIPE, ("HEIGHT", f"{hand + 0.0005}"), ("DEEP", f"{hand}"))
    assert "inside this surface" not in invoke("check", path).output
    assert "inside this surface" not in invoke("check", wipe(tmp_path)).output
