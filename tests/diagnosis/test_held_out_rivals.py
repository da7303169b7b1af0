# SPDX-License-Identifier: BSD-3-Clause
"""A cause that fails on the held-out recordings gives way to a rival that holds there, and to no other."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import held_out_rivals
from impedance_modules.diagnosis.model_selection.held_out_rivals import LACKING, with_likelier_rivals
from impedance_modules.diagnosis.model_selection.rivals import DECIDED


@dataclass(frozen=True)
class Evidence:
    """What a model leaves of one joint's held-out recording, and the rivals of its cause."""

    selector: SimpleNamespace
    model_fit: SimpleNamespace
    left: float

    def foretold_power(self, fit: SimpleNamespace) -> np.ndarray:
        return np.array([1.0, self.left])

    def held_out_likelihood(self, fit: object) -> float:
        return 0.0


def term(effect: str, *groups: int) -> SimpleNamespace:
    return SimpleNamespace(
        key=(effect, "elbow", "link"), groups=groups, candidate=SimpleNamespace(name=f"{effect} on elbow")
    )


def trial(effect: str) -> SimpleNamespace:
    return SimpleNamespace(term=term(effect, 1))


def exchanged(
    monkeypatch: pytest.MonkeyPatch,
    rivals: list[SimpleNamespace],
    leads: dict[str, float],
    *,
    left: float = 2.0 * LACKING,
    refused: str = "",
) -> tuple[list[str], tuple[str, ...]]:
    """Names of the model, of a friction at another joint and a ripple, once the ripple was compared."""
    model = [term("friction", 0), term("ripple", 1)]
    monkeypatch.setattr(held_out_rivals, "best_of_each", lambda ranked, most: ranked)
    monkeypatch.setattr(held_out_rivals, "try_term", lambda rest, one: trial(one.key[0]))
    monkeypatch.setattr(held_out_rivals, "refit", lambda own: own)
    monkeypatch.setattr(held_out_rivals, "correlation_surplus", lambda fit, groups: 2.0)
    monkeypatch.setattr(
        held_out_rivals, "lead_of", lambda own, fit, held_out: lambda other: leads[other.term.key[0]]
    )
    selector = SimpleNamespace(
        model_fit=lambda terms: SimpleNamespace(model=list(terms)),
        screen=SimpleNamespace(rank=lambda fit: [SimpleNamespace(layout=rival) for rival in rivals]),
        trial=lambda fit, layout: layout,
        refined=lambda fit, trials: trials,
        rejection_reason=lambda one: "no" if one.term.key[0] == refused else None,
    )
    found, notes = with_likelier_rivals(Evidence(selector, SimpleNamespace(model=model), left))
    return [one.key[0] for one in found.model_fit.model], notes


def test_the_likeliest_rival_takes_the_place_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ripple on a hundredth of the range is a spring; over all of it only the spring holds."""
    rivals, leads = [trial("offset"), trial("spring")], {"offset": -500.0, "spring": -900.0}
    named, notes = exchanged(monkeypatch, rivals, leads)
    assert named == ["friction", "spring"]
    assert notes == (
        "not named: ripple on elbow: it fails on the held-out recordings, and by all together spring on elbow is"
        " likelier",
    )


@pytest.mark.parametrize(
    ("lead", "left", "refused"),
    [
        (-1.9 * DECIDED, 2.0 * LACKING, ""),
        (-900.0, 0.9 * LACKING, ""),
        (-900.0, 2.0 * LACKING, "spring"),
    ],
    ids=["not decided", "the cause holds", "refused"],
)
def test_nothing_is_exchanged_without_need(
    monkeypatch: pytest.MonkeyPatch, lead: float, left: float, refused: str
) -> None:
    named, notes = exchanged(monkeypatch, [trial("spring")], {"spring": lead}, left=left, refused=refused)
    assert named == ["friction", "ripple"] and notes == ()


def test_a_cause_without_rivals_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    assert exchanged(monkeypatch, [], {}) == (["friction", "ripple"], ())
