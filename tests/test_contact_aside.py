# SPDX-License-Identifier: BSD-3-Clause
"""Phases that say contact are left aside by the diagnosis, all others count."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.aside import touching


@pytest.mark.parametrize("name", ["contact", "in_contact", "Contact 2", "press-contact", "contact_left"])
def test_a_phase_of_contact_marks_its_times_and_no_others(name: str) -> None:
    random = np.random.default_rng(len(name))
    time = np.cumsum(random.uniform(0.008, 0.012, 400))
    inside = np.zeros(400, dtype=bool)
    for start in random.integers(0, 350, 3):
        inside[start : start + 40] = True
    phase = np.where(inside, name, "free").astype(object)
    marks = touching(SimpleNamespace(phase=phase, time=time), time)
    np.testing.assert_array_equal(marks, inside)
    even = np.linspace(time[0], time[-1], 777)
    off = touching(SimpleNamespace(phase=phase, time=time), even)
    # A resampled instant lies within one sample of an instant with its mark.
    near = np.abs(time[None] - even[:, None]) <= 0.0121
    assert all(mark in inside[row] for mark, row in zip(off, near, strict=True))


@pytest.mark.parametrize(
    "name", ["free", "contactless", "no contact", "before contact", "until contact", "reach", None]
)
def test_other_phases_leave_everything(name: str | None) -> None:
    time = np.arange(100) / 100.0
    phase = np.full(100, name, dtype=object)
    assert touching(SimpleNamespace(phase=phase, time=time), time) is None
    assert touching(SimpleNamespace(phase=None, time=time), time) is None
