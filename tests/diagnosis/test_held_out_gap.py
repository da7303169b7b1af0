# SPDX-License-Identifier: BSD-3-Clause
"""How far the gap shrinks is what the patch does: on the held-out recordings, and on one that was never given."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.wide.promise import obtained
from impedance_modules.diagnosis.gap_result import total_shrink
from tests.diagnosis.test_diagnosis import answer, record

POINTS = 0.05
"""Between what is promised and what is obtained."""


def shrink(*gaps: tuple[float, float, float]) -> float | None:
    """Of residuals with an rms before and after, and a noise floor."""
    return total_shrink(*np.reshape(gaps, (-1, 3)).T)


def test_the_shrink_adds_squares_in_units_of_each_floor() -> None:
    start, left = (25.0 - 1.0) + (36.0 - 1.0), (4.0 - 1.0) + (9.0 - 1.0)
    assert shrink((5.0, 2.0, 1.0), (0.6, 0.3, 0.1)) == pytest.approx(1.0 - np.sqrt(left / start))
    assert shrink((5.0, 0.5, 1.0)) == 1.0
    assert shrink((1.0, 0.5, 1.0)) is None
    assert shrink() is None


def test_a_residual_that_a_cause_lifts_out_of_its_noise_counts() -> None:
    assert shrink((5.0, 1.0, 1.0), (0.9, 4.0, 1.0)) == pytest.approx(1.0 - np.sqrt(15.0 / 24.0))
    assert shrink((5.0, 1.0, 1.0)) == 1.0


@pytest.mark.parametrize("effect", ["viscous_friction", "parallel_spring"])
def test_the_patch_does_what_was_promised(tmp_path: Path, effect: str) -> None:
    """One link is 2 % heavier than stated, which no patch holds: of a small friction, it leaves most of the gap."""
    *given, withheld = record(tmp_path, effect, noise=0.01)
    patch, held = tmp_path / "found.yaml", ("--holdout", given[-1])
    said = answer(tmp_path, given[:-1], *held, "--patch", patch)[1]["gap"]
    patched = answer(tmp_path, given[:-1], *held, "--effects", patch)[1]["gap"]
    for before, after in zip(said["per_port"], patched["per_port"], strict=True):
        assert after["before"] == pytest.approx(before["after"], rel=1e-4), before["joint"]
    shoulder = next(item for item in said["per_port"] if item["joint"] == "shoulder")
    assert shoulder["refitted"] < 0.7 * shoulder["after"] and said["refitted_shrink"] > 0.95

    unseen = given[0], "--holdout", withheld
    before, after = (
        answer(tmp_path, [unseen[0]], *unseen[1:], *more)[1]["gap"] for more in ((), ("--effects", patch))
    )
    assert said["shrink"] == pytest.approx(obtained(before, after), abs=POINTS)
    assert said["shrink"] > 0.1
