# SPDX-License-Identifier: BSD-3-Clause
"""Phases of contact are masked by the diagnosis, all other samples are used."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from impedance_modules.diagnosis.data.admission import in_contact
from impedance_modules.diagnosis.residuals.band import Band
from impedance_modules.diagnosis.residuals.contact_mask import (
    contact_note,
    near_contact,
    rows_of_link_residuals,
    without_links_in_contact,
)
from impedance_modules.diagnosis.rollout.simulated_windows import HISTORY, WINDOW, place_windows
from impedance_modules.effects.residual_kinds import RESIDUALS, uses_motion
from impedance_modules.spec.task_text import contact_phases
from tests.support.paths import CHECKOUT


@pytest.mark.parametrize("name", ["contact", "in_contact", "Contact 2", "press-contact", "contact_left"])
def test_a_phase_of_contact_marks_its_times_and_no_others(name: str) -> None:
    random = np.random.default_rng(len(name))
    time = np.cumsum(random.uniform(0.008, 0.012, 400))
    inside = np.zeros(400, dtype=bool)
    for start in random.integers(0, 350, 3):
        inside[start : start + 40] = True
    phase = np.where(inside, name, "free").astype(object)
    episode = SimpleNamespace(phase=phase, time=time, metadata={})
    np.testing.assert_array_equal(in_contact(episode, time), inside)
    even = np.linspace(time[0], time[-1], 777)
    off = in_contact(episode, even)
    # A resampled instant lies within one sample of an instant with its mark.
    near = np.abs(time[None] - even[:, None]) <= 0.0121
    assert all(mark in inside[row] for mark, row in zip(off, near, strict=True))


@pytest.mark.parametrize(
    "name", ["free", "contactless", "no contact", "before contact", "until contact", "reach", None]
)
def test_other_phases_leave_everything(name: str | None) -> None:
    time = np.arange(100) / 100.0
    phase = np.full(100, name, dtype=object)
    assert in_contact(SimpleNamespace(phase=phase, time=time, metadata={}), time) is None
    assert in_contact(SimpleNamespace(phase=None, time=time, metadata={}), time) is None


TASKS = CHECKOUT / "tasks"


@pytest.mark.parametrize(
    ("task", "spent"),
    [
        ("reach-and-return", {}),
        ("mirrored-arms", {}),
        ("wipe-table", {"touch": "at its end", "wipe": "throughout", "lift": "throughout"}),
        ("box-hold", {"hold": "throughout", "lift": "throughout", "stay": "throughout"}),
    ],
)
def test_a_task_states_its_phases_of_contact(task: str, spent: dict[str, str]) -> None:
    assert contact_phases((TASKS / f"{task}.yaml").read_text()) == spent


@pytest.mark.parametrize(
    ("until", "free"), [("false", True), ("{present: false, force: 3}", True), ("{force: 3}", False)]
)
def test_contact_ends_with_the_phase_that_waits_for_its_loss(until: str, free: bool) -> None:
    text = f"""
phases:
  - {{name: near, until: {{contact: true}}}}
  - {{name: leave, until: {{contact: {until}}}}}
  - {{name: away}}
"""
    found = contact_phases(text)
    assert found["near"] == "at its end"
    assert found["leave"] == "throughout"
    assert ("away" not in found) is free


@pytest.mark.parametrize("text", ["", "no task", "- 1", "a: [1", "phases: 3", "phases: [1, {name: x}]"])
def test_a_text_that_is_no_task_states_no_contact(text: str) -> None:
    assert contact_phases(text) == {}


def test_a_phase_that_waits_for_contact_is_free_but_for_its_end() -> None:
    time = np.arange(600) / 100.0
    phase = np.array(["touch"] * 300 + ["wipe"] * 300, dtype=object)
    text = (TASKS / "wipe-table.yaml").read_text()
    marks = in_contact(SimpleNamespace(phase=phase, time=time, metadata={"task": text}), time)
    assert not marks[:240].any()
    assert marks[260:].all()


@dataclass(frozen=True)
class _Item:
    """What the stages of contact read of a prepared recording."""

    log: Any
    residuals: dict[str, Any]
    samples: int
    time: np.ndarray
    band: Any = None


def _item(touched: slice, residuals: tuple[str, ...] = ("link", "actuator", "velocity")) -> _Item:
    marks = np.zeros(1000, dtype=bool)
    marks[touched] = True
    log = SimpleNamespace(in_contact=marks, rate=100.0, start=0.0, duration=10.0, gaps=np.zeros((0, 2)))
    band = SimpleNamespace(step=1, rate=100.0, reach=0.2, cutoff=10.0)
    return _Item(log, dict.fromkeys(residuals, 0.0), 1000, np.arange(1000) / 100.0, band)


@pytest.mark.parametrize("cutoff", [3.7, 10.0, 20.0])
def test_a_knock_is_masked_as_far_as_the_filter_spreads_it(cutoff: float) -> None:
    """Beside 7 N.m of a hand that lands, a tenth of a percent is a push where sensors are good to 5 mN.m."""
    rate, touched = 100.0, slice(600, 700)
    band = Band(rate, cutoff, max(1, int(rate / (2.5 * cutoff))))
    item = replace(_item(touched), band=band)
    knock = np.zeros(1000)
    knock[touched] = 7.0
    rows = band.condense(knock)
    time = (band.margin + band.step * np.arange(len(rows))) / rate
    item = replace(item, samples=len(rows), time=time)
    free = ~near_contact(item)
    assert np.abs(rows[free]).max() < 1e-9
    assert free.sum() > 0.5 * len(rows)
    assert np.abs(rows[~near_contact(item, 0.5 * band.reach)]).max() > 7e-4


def test_contact_masks_only_residuals_of_the_links_motion() -> None:
    mask = np.arange(10) > 4
    groups = [(residual, 0) for residual in RESIDUALS]
    found = rows_of_link_residuals({3: mask}, groups)
    assert {groups[g][0] for _, g in found} == {residual for residual in RESIDUALS if uses_motion(residual)}
    assert all(r == 3 for r, _ in found)


def test_links_are_not_judged_where_nearly_all_is_contact_but_drives_are() -> None:
    (found,) = without_links_in_contact((_item(slice(50, 1000)),), (0,))
    assert set(found.residuals) == {"actuator", "velocity"}
    for item in (_item(slice(700, 1000)), _item(slice(50, 1000), ("motor", "velocity"))):
        assert without_links_in_contact((item,), (0,)) == (item,)
    both = _item(slice(0, 1000)), _item(slice(0, 0))
    assert set(without_links_in_contact(both, (0,))[1].residuals) == {"actuator", "velocity"}
    assert without_links_in_contact(both, (0, 1)) == both


@pytest.mark.parametrize("held", [None, False, True])
def test_a_note_says_why_rows_are_left_out(held: bool | None) -> None:
    item = _item(slice(400, 500))
    item.log.carrying = None if held is None else np.full(1000, held)
    (said,) = contact_note([item], (0,))
    assert said.startswith("1.4 s holding an object or in contact" if held else "1.4 s in contact")
    assert ("object's weight" in said) is bool(held)


def test_no_window_is_simulated_during_contact() -> None:
    items = [_item(slice(200, 500)), _item(slice(450, 600))]
    windows = place_windows(items, [0, 1], 12)
    assert len(windows) > 12
    for window in windows:
        for item in items:
            first, last = round(100 * (window.start - HISTORY)), round(100 * (window.start + WINDOW))
            assert not item.log.in_contact[first : last + 1].any()
    assert place_windows([_item(slice(0, 1000))], [0], 5) == []
