# SPDX-License-Identifier: BSD-3-Clause
"""Sanding at its shortest: held by splinters and free again, roughness told apart, the rule, and the end of a task."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_experiments.sanding_course import WEAR, Course, long_board, task_wear
from impedance_experiments.sanding_rule import roc_curve, set_bound, smooth_statistics
from impedance_experiments.sanding_runs import SHALLOW, board_of, sanding_task


@pytest.mark.long
def test_it_is_held_comes_free_works_and_feels_what_is_rough(facts_of) -> None:
    facts = facts_of("sanding")
    assert 4.0 < facts["stuck"] < 12.0 and facts["broken"] >= 1.0
    # True force times true velocity, against what the wood was rubbed and its splinters gave.
    assert facts["work"] == pytest.approx(facts["spent_on_wood"], rel=0.1)
    assert facts["band_rough"] > 2.0 * facts["band_smooth"]
    assert facts["friction_rough"] > facts["friction_smooth"] + 0.1
    assert facts["friction_smooth"] == pytest.approx(0.49, abs=0.1)
    assert facts["away_upright"] > 0.8 > 0.6 > facts["away_slanted"]
    # The long sanding at its shortest: a few strokes on wood that hardly wears.
    assert 0.8 < facts["long_fall"] < 1.1 and facts["long_work"] > 1.0
    # Smooth from the start: three windows, then the phase is over long before its 60 s.
    assert 9.0 < facts["finished_at"] < 25.0


def test_a_long_sanding_changes_wear_and_tank_and_nothing_else() -> None:
    own, worn = board_of(sanding_task(SHALLOW)), long_board(SHALLOW, WEAR)
    assert worn.wood.roughness.wear == WEAR and task_wear(SHALLOW) < WEAR
    texture = replace(worn.wood.roughness, wear=own.wood.roughness.wear)
    assert replace(worn, wood=replace(worn.wood, roughness=texture)) == own


def test_start_and_end_of_a_course_are_its_first_and_last_strokes() -> None:
    windows = np.column_stack([np.arange(20.0), np.geomspace(1.0, 0.5, 20), np.ones((20, 2))])
    nothing = np.zeros((1, 3))
    course = Course(SHALLOW, 60.0, windows, nothing[:, :2], nothing, 0.0, 0, 0, 0.0, "done")
    assert course.start[0, 0] == 0.0 and course.end[-1, 0] == 19.0
    assert len(course.start) == len(course.end) == 8
    assert course.fall == pytest.approx(0.5 ** (12.0 / 19.0))


def test_the_bound_lies_where_it_tells_most_apart() -> None:
    rng = np.random.default_rng(0)
    smooth, rough = rng.normal(1.0, 0.2, 200), rng.normal(2.0, 0.2, 200)
    assert 1.3 < set_bound(smooth, rough) < 1.7
    assert roc_curve(smooth, rough).area > 0.99
    assert roc_curve(rough, smooth).area < 0.01
    assert roc_curve(smooth, rng.normal(1.0, 0.2, 200)).area == pytest.approx(0.5, abs=0.1)
    stuck = np.array([np.inf, np.inf, 2.0])
    curve = roc_curve(np.array([1.0, 1.1, 3.0]), stuck)
    # A stuck piece says nothing about where rough pieces lie.
    assert set_bound(np.array([1.0, 1.1, 3.0]), stuck) == set_bound(np.array([1.0, 1.1, 3.0]), stuck[2:])
    assert curve.true[-2] == 1.0 and curve.false[-2] == pytest.approx(1.0 / 3.0)


def test_wood_must_feel_smooth_in_both_ways() -> None:
    rng = np.random.default_rng(1)
    smooth = {"band": rng.normal(0.06, 0.005, 100), "friction": rng.normal(0.8, 0.08, 100)}
    # Rough wood that only the band tells, and rough wood that only friction tells.
    rough = {
        "band": np.concatenate([np.full(50, 0.12), np.full(50, 0.062)]),
        "friction": np.concatenate([np.full(50, 0.8), np.full(50, 1.3)]),
    }
    measures = smooth_statistics(smooth)
    apart, together = measures.worst(smooth), measures.worst(rough)
    bound = set_bound(apart, together)
    assert (apart < bound).all() and not (together < bound).any()
    for measure, scores in smooth.items():
        assert roc_curve(scores, rough[measure]).area < 0.95
    assert roc_curve(apart, together).area == 1.0
    limits = measures.bounds(bound)
    both = (rough["band"] < limits["band"]) & (rough["friction"] < limits["friction"])
    assert not both.any() and (smooth["band"] < limits["band"]).all()
