# SPDX-License-Identifier: BSD-3-Clause
"""A knock on one joint: no law has it and no name is made up for it, and what is there all the time is found beside it.

The recordings are those of `test_diagnosis`; the knock is half a sine of torque on the elbow.
"""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import search_beside_disturbances
from impedance_modules.diagnosis.model_selection.search_beside_disturbances import without_disturbances
from tests.diagnosis.test_diagnosis import answer, record

LENGTH = 0.3
"""Of a knock [s]."""


def knock(size: float, *where: tuple[int, float]) -> Callable[[np.ndarray, int], np.ndarray]:
    """Knocks of a size [N.m], each in one recording at one time [s]."""

    def law(t: np.ndarray, index: int) -> np.ndarray:
        out = 0.0 * t
        for recording, start in where:
            inside = (recording == index) & (t > start) & (t < start + LENGTH)
            out += size * np.sin(np.pi * (t - start) / LENGTH) * inside
        return out

    return law


def note_of(found: dict) -> str:
    return " ".join(note for note in found["data"]["warnings"] if "no law has what acts then" in note)


@pytest.mark.parametrize("effect", ["coulomb_friction", "viscous_friction"])
@pytest.mark.parametrize("where", [(2, 7.0), (4, 12.0)])
def test_friction_is_found_beside_a_knock_and_the_gap_stays_open(tmp_path: Path, effect: str, where) -> None:
    code, found = answer(tmp_path, record(tmp_path, effect, knock=knock(9.0, where)))
    first = found["causes"][0]
    assert (first["effect"], first["joints"]) == (effect, ["elbow"])
    (symbol,) = first["parameters"]["elbow"]
    number = first["parameters"]["elbow"][symbol]
    true = {"fc": 0.25, "fv": 0.3}[symbol]
    assert number["value"] == pytest.approx(true, rel=0.15)
    assert found["verdict"] == "partly_explained" and code == 5
    assert found["unexplained_weight"] > 0.3  # the knock's share
    said = note_of(found)
    recording, start = where
    assert said.startswith(f"run{recording}: ") and "N.m on elbow" in said, said
    begin, end = (float(word) for word in said.split(": ")[1].removesuffix(" s").split(" to "))
    assert start - 1.0 < begin < start and start + LENGTH < end < start + LENGTH + 1.0


def test_a_knock_alone_is_no_cause_and_no_silence(tmp_path: Path) -> None:
    code, found = answer(tmp_path, record(tmp_path, "nothing", knock=knock(9.0, (1, 5.0), (3, 15.0))))
    assert (code, found["verdict"], found["causes"]) == (5, "unexplained", [])
    assert "run1: " in note_of(found) and "run3: " in note_of(found)
    assert "single moments exceed the noise on elbow" in found["remainder"]["structure"]


def test_a_knock_within_the_tolerance_is_small(tmp_path: Path) -> None:
    paths = record(tmp_path, "nothing", noise=1e-4, jitter=1e-7, knock=knock(0.03, (1, 5.0)))
    assert answer(tmp_path, paths, "--tolerance", "0")[1]["verdict"] == "unexplained"
    assert answer(tmp_path, paths)[1]["verdict"] == "no_gap"


def searched(monkeypatch: pytest.MonkeyPatch, masks: list[np.ndarray], *well: bool) -> tuple[str, int, dict]:
    """A search that leaves out one mask (M,) after the other, and whether what it finds then fits as well.

    Returns which search stands, how many were done, and the rows that are left out.
    """
    calm, fits, runs = iter([*({(0, 0): ~mask} for mask in masks), {}]), iter(well), []
    monkeypatch.setattr(search_beside_disturbances, "_clear_rows", lambda *_: next(calm))
    monkeypatch.setattr(search_beside_disturbances, "fits_as_well", lambda *_: next(fits, True))

    class Searching:
        def __init__(self, name: str, clear: dict) -> None:
            self.name = name
            self.design = SimpleNamespace(whitening=SimpleNamespace(clear=clear), without=lambda mask: mask)

        def model_fit(self, _: object) -> None: ...

        def on(self, clear: dict) -> "Searching":
            return Searching(f"{self.name}+", clear)

        def run(self, _: object) -> SimpleNamespace:
            runs.append(self.name)
            return SimpleNamespace(causes=[])

    first = Searching("all", {})
    selector, _, left_out = without_disturbances(first, SimpleNamespace(causes=[]), [], lambda _: None)
    return (
        selector.name,
        len(runs),
        {place: np.flatnonzero(lost).tolist() for place, lost in left_out.items()},
    )


def rows(*places: int) -> np.ndarray:
    return np.isin(np.arange(20), places)


def test_moments_that_lay_hidden_are_left_out_too(monkeypatch) -> None:
    assert searched(monkeypatch, [rows(3), rows(3, 12)]) == ("all++", 2, {(0, 0): [3, 12]})


def test_the_search_is_repeated_three_times_at_most(monkeypatch) -> None:
    each = [rows(place) for place in (1, 2, 3, 4)]
    assert searched(monkeypatch, each) == ("all+++", 3, {(0, 0): [1, 2, 3]})


def test_a_fifth_of_all_rows_is_no_moment(monkeypatch) -> None:
    assert searched(monkeypatch, [rows(*range(5))]) == ("all", 0, {})
    assert searched(monkeypatch, [rows(3), rows(*range(8))]) == ("all", 1, {})


def test_a_search_whose_causes_fit_worse_does_not_stand(monkeypatch) -> None:
    """Without these moments the first causes explain the other rows better: what was found is for want of them."""
    assert searched(monkeypatch, [rows(3)], False) == ("all", 1, {})
    assert searched(monkeypatch, [rows(3), rows(12)], True, False) == ("all+", 2, {(0, 0): [3]})
