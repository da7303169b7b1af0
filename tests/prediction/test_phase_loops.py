# SPDX-License-Identifier: BSD-3-Clause
"""Loops are judged where every phase comes to rest."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.phase_loops import PhaseLoops, judge_loops
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.prediction.statics import find_rest
from tests.support.commands import refusal
from tests.support.forecast_tasks import assembled, write_task

UNFOLDING = """
format: 1
name: unfolding
robot: baxter
arms:
  right:
    posture: {s0: -1.4053, s1: -1.0067, e0: 2.5324, e1: 0.0042, w0: -2.3816, w1: -1.0099, w2: -2.9853}
    joint_bias:
      stiffness: {s0: 1.45, s1: 5.66, e0: 1.30, e1: 17.98, w0: 2.84, w1: 39.94, w2: 1.40}
      damping_ratio: 0.7672
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 617.4, y: 509.6, z: 197.2, rx: 20.7, ry: 25.9, rz: 16.0}
        damping_ratio: 0.7681
safety: {tank: {initial: 12.0, max: 24.0, floor: 0.3}}
phases:
  - {name: begin, equilibrium: {right.hand: {x: 0.0414, y: -0.1444, z: 1.252}}, duration: 0.9}
  - {name: unfold, equilibrium: {right.hand: {x: -0.1448, y: -0.5471, z: 1.2853}}, duration: 1.0}
"""
"""An arm whose loop is stable where it begins, with the same gains unstable where it ends (it shakes on the plant)."""


def test_a_posture_that_is_reached_later_is_judged_too(tmp_path: Path) -> None:
    path = write_task(tmp_path, UNFOLDING)
    text = refusal("check", path, "--rate", 405)
    assert "the loop of 'right' is predicted to be unstable" in text and "phase 'unfold'" in text
    named = re.search(r"at most (\d+) N/m instead of 617", text)
    assert named is not None
    # The first phase alone is accepted, and so are springs as soft as the refusal names.
    path.write_text(re.sub(r"  - \{name: unfold.*\n", "", UNFOLDING))
    refuse_infeasible(assembled(path, rate=405))
    share = 0.98 * int(named[1]) / 617.4
    softer = UNFOLDING
    for value in ("617.4", "509.6", "197.2", "20.7", "25.9", "16.0"):
        softer = softer.replace(value, f"{share * float(value):.4f}")
    path.write_text(softer)
    assert all(growth(found) <= 1.0 for found in judged(assembled(path, rate=405)))


def judged(assembly: Assembly) -> tuple[PhaseLoops, ...]:
    motion, mechanism = predict_motion(assembly), Mechanism(assembly)
    rests = [find_rest(mechanism, phase.setting, phase.q) for phase in motion.phases]
    return judge_loops(assembly, mechanism, motion, rests)


def growth(found: PhaseLoops) -> float:
    return max(loop.oscillating_growth for loop in found.loops)


def test_phases_with_the_same_gains_share_the_worst(tmp_path: Path) -> None:
    first, second = judged(assembled(write_task(tmp_path, UNFOLDING), rate=405))
    assert first is second
    assert first.phase == 1 and growth(first) > 1.01
    assert np.isfinite(first.loops[0].stiffness)
