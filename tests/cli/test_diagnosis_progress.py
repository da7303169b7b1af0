# SPDX-License-Identifier: BSD-3-Clause
"""The bar of a diagnosis: time left by the usual shares of its stages, and nothing where there is no terminal."""

import io

import pytest
from rich.console import Console

from impedance_modules.cli.diagnosis_progress import diagnosis_progress, seconds_left, share_passed
from impedance_modules.diagnosis.diagnose import USUAL_SHARES


@pytest.mark.parametrize("whole", [3.0, 40.0])
def test_a_diagnosis_with_the_usual_shares_is_told_its_time_left(whole: float) -> None:
    for share in USUAL_SHARES.values():
        for later in (0.0, 0.05 * whole):
            left = seconds_left(share * whole, share, later)
            assert left is None if share == 0.0 else left == pytest.approx(whole * (1.0 - share) - later)


def test_a_stage_that_takes_longer_than_usual_is_told_nothing() -> None:
    assert seconds_left(9.0, 0.9, 0.5) == pytest.approx(0.5)
    assert seconds_left(9.0, 0.9, 1.5) is None


def test_stages_stand_in_the_order_of_their_shares() -> None:
    shares = list(USUAL_SHARES.values())
    assert shares == sorted(shares)
    assert all(0.0 <= share < 1.0 for share in shares)


def test_a_stage_that_is_repeated_does_not_move_the_bar_back() -> None:
    late, early = USUAL_SHARES["concluding"], USUAL_SHARES["judging rivals"]
    assert share_passed("judging rivals", late) == late
    assert share_passed("concluding", early) == late
    assert share_passed("found payload on hand", early) == early


def test_the_bar_shows_the_stage_as_text() -> None:
    shown = io.StringIO()
    with diagnosis_progress(Console(file=shown, force_terminal=True, width=100)) as step:
        step("found payload on [bold]")
    assert "found payload on [bold]" in shown.getvalue()


def test_nothing_is_written_where_there_is_no_terminal() -> None:
    shown = io.StringIO()
    with diagnosis_progress(Console(file=shown, force_terminal=False)) as step:
        for words in USUAL_SHARES:
            step(words)
    assert not shown.getvalue()
