# SPDX-License-Identifier: BSD-3-Clause
"""What the simulated motion refuses makes room for others."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import repeated_search as stages
from impedance_modules.diagnosis.model_selection.naming import rejection
from impedance_modules.diagnosis.model_selection.repeated_search import REFUSED_MAX, RepeatedSearch
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.sensor_effects import GAIN_MAX, TorqueGain

ORDER = ("crosstalk", "base_tilt", "torque_offset", "payload", "torque_gain")
"""Effects in the order in which a search finds them, one at a time."""


def left_alone(
    evidence: SimpleNamespace, refusals: tuple[SimpleNamespace, ...]
) -> tuple[SimpleNamespace, tuple[str]]:
    return SimpleNamespace(model_fit=evidence.model_fit, pushes=(), notes=(), left=refusals), ("alone",)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[set, set]]:
    """What each search was to do without: effects, and candidates."""
    seen: list[tuple[set, set]] = []

    def search(
        _prepared: tuple,
        _split: None,
        _model: None,
        without: Collection[str],
        *_: object,
        refused: Collection[tuple],
    ) -> SimpleNamespace:
        seen.append((set(without), set(refused)))
        taken = {key[0] for key in refused}
        first = next(effect for effect in ORDER if effect not in taken)
        term = SimpleNamespace(key=(first, "lift", "sensor"))
        return SimpleNamespace(model_fit=SimpleNamespace(model=[term]), pushes=(), notes=(f"found {first}",))

    monkeypatch.setattr(stages, "search_causes", search)
    for stage in (
        "weighed_where_they_act",
        "without_unconfirmed",
        "with_likelier_rivals",
        "without_weightless",
    ):
        monkeypatch.setattr(stages, stage, lambda evidence: (evidence, ()))
    monkeypatch.setattr(stages, "without_causes", left_alone)
    return seen


def cause(effect: str, weight: float = 1.0) -> SimpleNamespace:
    port = "contact" if effect == "external_contact" else "sensor"
    return SimpleNamespace(
        effect=effect, port=port, joints=("lift",), weight=weight, rollout=None, probability=None
    )


def search() -> RepeatedSearch:
    return RepeatedSearch((), None, None, {"water"}, lambda _: None, map)


def test_without_a_refused_cause_another_is_found(asked) -> None:
    found, first = search(), cause("crosstalk")
    found.leave_out([first], [first])
    assert asked[1] == ({"water"}, {("crosstalk", "lift", "sensor")})
    assert found.evidence.model_fit.model[0].key[0] == "base_tilt"
    assert found.notes == (
        "found base_tilt",
        rejection(first),
    )


def test_a_minor_cause_that_is_refused_starts_no_search(asked) -> None:
    found, minor, major = search(), cause("crosstalk", 0.01), cause("payload", 0.9)
    found.leave_out([minor], [major, minor])
    assert len(asked) == 1 and found.evidence.left[0] is minor
    assert found.notes[-2:] == (
        rejection(minor),
        "alone",
    )


def test_the_search_is_not_repeated_for_ever(asked) -> None:
    found = search()
    for effect in ORDER:
        found.leave_out([cause(effect)], [cause(effect)])
    assert len(asked) == 1 + REFUSED_MAX and len(found.evidence.left) == 1


@pytest.mark.parametrize(
    ("factor", "believed"), [(0.35, True), (0.58, True), (2.9, True), (0.3, False), (3.1, False)]
)
@pytest.mark.parametrize("port", ["sensor", "actuator"])
def test_a_torque_may_be_three_times_too_much_or_too_little(
    port: Port, factor: float, believed: bool
) -> None:
    """A wrong torque constant of 0.6 was refused as no number that a sensor can have; a drive's 0.06 was named."""
    torque = np.ones((3, 1))
    signals = SimpleNamespace(effort=torque, drive=torque, joint=lambda _: 0, samples=3, n=1)
    columns = TorqueGain().in_residual(Site(signals, "lift", port), "link", {})
    coefficient = 1.0 - 1.0 / factor if port == "sensor" else factor - 1.0
    assert bool(columns.lower[0] < coefficient < columns.upper[0]) is believed
    assert GAIN_MAX == 3.0


@dataclass(frozen=True)
class Found:
    """As much of the evidence as the search that goes on looks at."""

    model_fit: SimpleNamespace
    selector: SimpleNamespace
    refusal: str = "before"
    plain: None = None
    prepared: tuple[()] = ()
    gained: float = 10.0

    def held_out_likelihood(self, model_fit: SimpleNamespace) -> np.ndarray:
        return np.array([-5.0, self.gained * (len(model_fit.model) - 1)])


def exchanged(
    monkeypatch: pytest.MonkeyPatch, beside: Collection[str], certain: Collection[str], gained: float = 10.0
) -> tuple:
    """What stands once an offset took another's place; the search finds some beside it, of which some are certain.

    Each of these changes the likelihood of the held-out recordings by ``gained``.
    """
    offset = SimpleNamespace(key=("encoder_offset", "lift", "sensor"))
    more = [SimpleNamespace(key=(name, "lift", "actuator")) for name in beside]
    found = SimpleNamespace(causes=(offset, *more), refusal="after")
    selector = SimpleNamespace(go_on=lambda known, _: found if known == [offset] else None)
    monkeypatch.setattr(
        stages,
        "tested",
        lambda _selector, causes, *_: SimpleNamespace(
            model=[term for term in causes if term is offset or term.key[0] in certain]
        ),
    )
    monkeypatch.setattr(stages, "without_unconfirmed", lambda evidence: (evidence, ("confirmed",)))
    evidence, notes = stages._with_causes_beside(
        Found(SimpleNamespace(model=[offset]), selector, gained=gained), lambda _: None
    )
    return [term.key[0] for term in evidence.model_fit.model], evidence.refusal, notes


def test_the_search_goes_on_beside_what_took_anothers_place(monkeypatch) -> None:
    """It had stopped beside the wrong cause; what is found now must be certain and confirmed as the others are."""
    names = ["encoder_offset", "torque_offset"]
    found = exchanged(monkeypatch, ["torque_offset", "payload"], ["torque_offset"])
    assert found == (names, "after", ("confirmed",))
    for beside in ([], ["payload"]):
        assert exchanged(monkeypatch, beside, ["torque_offset"]) == (names[:1], "before", ())


def test_what_makes_the_held_out_recordings_less_likely_does_not_stand(monkeypatch) -> None:
    found = exchanged(monkeypatch, ["torque_offset"], ["torque_offset"], gained=-1.0)
    assert found == (["encoder_offset"], "before", ())
