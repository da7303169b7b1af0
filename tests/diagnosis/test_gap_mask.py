# SPDX-License-Identifier: BSD-3-Clause
"""Where samples were lost, nothing is known: rows about it do not count, and no cause is named."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.stamps import SEVERAL_LOST, gaps_of, stamp_jitter
from impedance_modules.diagnosis.residuals.band import Band
from impedance_modules.diagnosis.residuals.gap_mask import (
    FILLED_MAX,
    _far_from,
    lost_stretches,
    rows_without_gaps,
)
from impedance_modules.diagnosis.rollout.simulated_windows import HISTORY, WINDOW, place_windows
from tests.support.commands import invoke
from tests.support.plant_recordings import record, robot_folder

RATE, CUTOFF = 200.0, 10.0
REACH = (Band(RATE, CUTOFF, 5).margin + 7.5) / RATE
"""Half the filter's length, and a row [s]."""


def recording(gaps: np.ndarray, seconds: float = 10.0, start: float = 0.0) -> Any:
    time = start + np.arange(round(seconds * RATE / 5.0)) / (RATE / 5.0)
    log = SimpleNamespace(
        name="run", gaps=gaps, start=start, rate=RATE, duration=seconds, in_contact=None, group="run"
    )
    band = Band(RATE, CUTOFF, 5)
    return SimpleNamespace(time=time, samples=len(time), log=log, band=band)


@settings(max_examples=50, deadline=None)
@given(first=st.integers(5, 900), lost=st.integers(1, 15), rate=st.sampled_from([50.0, 200.0, 1000.0]))
def test_a_gap_is_where_samples_were_lost(first: int, lost: int, rate: float) -> None:
    time = np.delete(np.arange(1000) / rate, slice(first, first + lost))
    found = gaps_of(time)
    expected = [[(first - 1) / rate, (first + lost) / rate]]
    assert len(gaps_of(time, SEVERAL_LOST)) == (lost > 1)
    np.testing.assert_allclose(found, np.reshape(expected, (-1, 2)), atol=1e-12)
    assert stamp_jitter(time) == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(begin=st.floats(1.0, 9.0), length=st.floats(0.001, 0.1), start=st.sampled_from([0.0, 120.0]))
def test_rows_that_the_filter_brings_into_a_long_gap_do_not_count(
    begin: float, length: float, start: float
) -> None:
    gap = np.array([[begin, begin + length]]) + start
    item = recording(gap, start=start)
    clear = rows_without_gaps([item, recording(np.zeros((0, 2)))])
    length = gap[0, 1] - gap[0, 0]
    assert bool(len(lost_stretches(item))) == (length * CUTOFF > FILLED_MAX and length * RATE > SEVERAL_LOST)
    (mask,) = clear.values()
    assert list(clear) == [0]
    away = np.maximum(gap[0, 0] - item.time, item.time - gap[0, 1])
    decided = np.abs(away - REACH) > 1e-9
    np.testing.assert_array_equal(mask[decided], (away > REACH)[decided])


@settings(max_examples=50, deadline=None)
@given(steps=st.lists(st.floats(0.15, 6.0), min_size=1, max_size=40), length=st.floats(0.025, 0.14))
def test_of_many_gaps_each_counts(steps: list[float], length: float) -> None:
    """They are looked up at once; one by one they mask the same rows."""
    begin = np.cumsum(steps)
    item = recording(np.column_stack([begin, begin + length]), float(begin[-1]) + 2.0)
    near = [(item.time >= t - REACH) & (item.time <= t + length + REACH) for t in begin]
    np.testing.assert_array_equal(_far_from(item, np.ones(len(begin), dtype=bool)), ~np.any(near, axis=0))


@pytest.mark.parametrize(("seconds", "masked"), [(10.0, False), (40.0, True)])
def test_short_gaps_cost_rows_where_they_are_rare(seconds: float, masked: bool) -> None:
    """What was filled in is as good as its noise, but torques that are compared differ by less than that."""
    clear = rows_without_gaps([recording(np.array([[4.0, 4.015], [7.0, 7.015]]), seconds)])
    assert bool(clear) == masked
    assert all(not mask[int(4.0 * RATE / 5.0)] and mask[10] for mask in clear.values())


def test_single_samples_count_after_stretches_where_both_cost_too_many_rows() -> None:
    """At 50 Hz one lost sample is long beside a period of 10 Hz; the stretches are left out in any case."""
    stretches = [(3.0, 3.1), (9.0, 9.1)]
    few, many = ([(t, t + 0.04) for t in np.arange(4.0, end, 0.7)] for end in (5.5, 18.0))

    def masked(singles: list[tuple[float, float]]) -> list[bool]:
        item = recording(np.array(sorted([*stretches, *singles])), 20.0)
        item.log.rate = 50.0
        mask = rows_without_gaps([item])[0]
        return [not mask[np.argmin(np.abs(item.time - time))] for time in (3.05, 9.05, singles[0][0] + 0.02)]

    assert masked(few) == [True, True, True]
    assert masked(many) == [True, True, False]


def test_where_gaps_are_everywhere_the_recordings_are_taken_as_they_are() -> None:
    begin = np.arange(0.5, 9.5, 0.4)
    assert rows_without_gaps([recording(np.column_stack([begin, begin + 0.05]))]) == {}


@pytest.mark.parametrize("start", [0.0, 300.0])
def test_no_simulation_begins_or_runs_where_samples_are_missing(start: float) -> None:
    gap = np.array([[4.0, 4.1]])
    windows = place_windows([recording(gap + start, start=start)], [0], 12)
    assert len(windows) > 8
    assert all(w.start - HISTORY > 4.1 or w.start + WINDOW < 4.0 for w in windows)


@pytest.mark.parametrize(
    "stalls",
    [
        pytest.param((1.5, 2.6, 4.1), id="stalled"),
        pytest.param((), id="steady", marks=pytest.mark.long),
    ],
)
def test_a_controller_that_stalls_is_no_gap(tmp_path: Path, stalls: tuple[float, ...]) -> None:
    """The robot holds its last command for 30 ms; what is written before and after does not say so."""
    robot = robot_folder(tmp_path)
    paths = record(tmp_path, robot, None, stalls=stalls, tremor=2.0)
    answer = tmp_path / "answer.json"
    run = invoke("diagnose", *paths, "--robot", robot, "--json", answer)
    assert run.return_value in (None, 0), run.output
    found = json.loads(answer.read_text())
    assert found["verdict"] == "no_gap"
    said = [words for words in found["data"]["warnings"] if "samples were lost" in words]
    assert len(said) == bool(stalls)
