# SPDX-License-Identifier: BSD-3-Clause
"""Which of several causes goes when they no longer earn their place together."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from impedance_modules.diagnosis.model_selection import backward_elimination as module
from impedance_modules.diagnosis.model_selection.backward_elimination import eliminate_backward


def term(name: str, *groups: int) -> SimpleNamespace:
    return SimpleNamespace(name=name, groups=groups)


@pytest.fixture
def judged(monkeypatch):
    """Prunes by a rule that is told a term and the names beside it, and says whether the term stands."""
    monkeypatch.setattr(module, "try_term", lambda beside, one: (one, {other.name for other in beside}))

    def prune(model, stands):
        return [
            one.name
            for one in eliminate_backward(
                model, list, lambda trial: None if stands(trial[0].name, trial[1]) else "no"
            )
        ]

    return prune


OFFSET, ASYMMETRY, OTHER = term("offset", 2), term("asymmetry", 2), term("spring", 0)


def test_what_stands_stays_and_what_does_not_goes(judged) -> None:
    assert judged([OTHER, OFFSET], lambda name, beside: name == "spring") == ["spring"]
    assert judged([OTHER, OFFSET], lambda name, beside: True) == ["spring", "offset"]


def test_a_cause_that_leans_on_another_goes_before_that(judged) -> None:
    """An asymmetry takes over part of an offset's work and is nothing without it: the offset is the cause."""

    def stands(name, beside):
        return {"spring": True, "offset": "asymmetry" not in beside, "asymmetry": "offset" in beside}[name]

    assert judged([OTHER, OFFSET, ASYMMETRY], stands) == ["spring", "offset"]


def test_a_cause_that_another_replaces_goes(judged) -> None:
    def stands(name, beside):
        return name != "offset" or "asymmetry" not in beside

    assert judged([OFFSET, ASYMMETRY], stands) == ["asymmetry"]


def test_what_leans_on_it_does_not_save_a_cause_that_is_none(judged) -> None:
    def stands(name, beside):
        return name == "asymmetry" and "offset" in beside

    assert judged([OFFSET, ASYMMETRY], stands) == []
