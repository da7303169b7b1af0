# SPDX-License-Identifier: BSD-3-Clause
"""Rules of the diagnosis beyond its model, each with what stands in its place when it is left out.

The model itself (residuals, nuisances with priors, noise, evidence on unseen recordings and its penalty) is no rule.
`benchmarks.wide.ablation` asks the cases again without one rule at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

INFINITE = float("inf")
_SEARCH = "model_selection.forward_selection"
ADDED, EXCHANGED = f"{_SEARCH}:Selector._next", f"{_SEARCH}:Selector._better"
REMOVED = "model_selection.backward_elimination:eliminate_backward"


@dataclass(frozen=True)
class Rule:
    """A rule of the diagnosis.

    Attributes:
        name: One word.
        does: What it does, in a few words.
        place: Where it stands, MODULE:NAME or MODULE:CLASS.NAME below `impedance_modules.diagnosis`.
        without: The number or function that takes its place.
        decisions: Functions whose result it can change, of the same form; of a function, itself when left out.
    """

    name: str
    does: str
    place: str
    without: Any
    decisions: tuple[str, ...] = ()

    @property
    def shows_in(self) -> tuple[str, ...]:
        """Functions whose result tells whether the rule made a difference."""
        return self.decisions or (self.place,)


def _always(value: object) -> Callable[..., Any]:
    """A function of anything that returns one value."""
    return lambda *_, **__: value


def _given(at: int) -> Callable[..., Any]:
    """A function that returns one of its arguments."""
    return lambda *arguments, **_: arguments[at]


def _given_with_none(at: int) -> Callable[..., Any]:
    """A function that returns an `Evidence` as it was given, and no notes."""
    return lambda *arguments, **_: (arguments[at], ())


def _number(name: str, does: str, place: str, without: float) -> Rule:
    """A rule of acceptance: a limit that a candidate must keep wherever it is accepted, exchanged or kept."""
    return Rule(name, does, f"model_selection.{place}", without, (ADDED, EXCHANGED, REMOVED))


def _check(name: str, does: str, place: str, passes: object) -> Rule:
    """A rule of acceptance: a test that a candidate must pass."""
    return Rule(name, does, f"model_selection.{place}", _always(passes), (ADDED, EXCHANGED, REMOVED))


ACCEPTANCE = (
    _number("harm", "a cause may not harm some recordings", "acceptance:HARM_MAX", INFINITE),
    _number(
        "reduction", "a cause removes 5 % of the squares where it acts", "acceptance:REDUCTION_MIN", -INFINITE
    ),
    _number(
        "narrow", "what should show on several joints helps on more than one", "acceptance:SPREAD", INFINITE
    ),
    _check("generic", "no smooth function without physics does better", "acceptance:_does_better", False),
    _number(
        "contrast", "what makes a law more than a simpler one is certain", "plausibility:CONTRAST_MIN", 0.0
    ),
    _check("comes-back", "what is explained comes back in a repeat", "plausibility:comes_back", True),
    _check("slow", "the slow half of a motion confirms a coefficient", "plausibility:holds_when_slow", True),
    _check(
        "load",
        "what is made of a command shows where torque is needed",
        "forward_selection:follows_load",
        True,
    ),
    _check(
        "answer",
        "a softer loop is more than a controller's answer",
        "plausibility:Plausibility.contradiction",
        None,
    ),
    _check(
        "nuisance",
        "links and stamps stay within their priors beside a cause",
        "plausibility:_moves_nuisance",
        False,
    ),
    _check("contained", "no law beside one that contains it", "plausibility:_contains_law", False),
    _number(
        "twice-removed",
        "what was removed twice is not accepted again",
        "forward_selection:REMOVALS_MAX",
        1000,
    ),
)

SEARCH = (
    Rule(
        "geared-start",
        "friction, damping and rotor of a geared joint together",
        f"{_SEARCH}:geared_start_model",
        _always(()),
    ),
    Rule(
        "exchange", "each new cause may exchange those beside it", f"{_SEARCH}:Selector._exchange", _given(1)
    ),
    Rule(
        "richer",
        "a law of dry friction with more numbers, as the accepted one reverses",
        f"{_SEARCH}:Selector._richer",
        lambda _, own: own,
    ),
    Rule("merge-delays", "one delay for several lags", f"{_SEARCH}:merge_delays", _given(0)),
    Rule("elimination", "causes that no longer pass are removed", f"{_SEARCH}:eliminate_backward", _given(0)),
    Rule(
        "shapes-anew",
        "shapes are found anew beside fewer causes",
        f"{_SEARCH}:Selector.reshaped",
        lambda _, model, __: list(model),
    ),
    Rule(
        "simplest", "a simpler law in the end", f"{_SEARCH}:Selector.simplest", lambda _, model: list(model)
    ),
    Rule(
        "one-for-two",
        "one law in the place of two",
        f"{_SEARCH}:Selector.one_for_two",
        lambda _, model: list(model),
    ),
    Rule(
        "reversals",
        "reversals are left out where dry friction is not understood",
        "model_selection.cause_search:_without_reversals",
        lambda selector, found, *_: (selector, found, ()),
    ),
    Rule(
        "pushes",
        "pushes are masked, and the search repeated",
        "model_selection.cause_search:without_pushes",
        lambda selector, found, *_: (selector, found, ()),
    ),
    Rule(
        "goes-on",
        "the search goes on beside a cause that took another's place",
        "model_selection.repeated_search:_with_causes_beside",
        lambda evidence, _: (evidence, ()),
    ),
    Rule(
        "disturbances",
        "moments that no law has are left out, and the search repeated",
        "model_selection.cause_search:without_disturbances",
        lambda selector, found, *_: (selector, found, {}),
    ),
    Rule(
        "unrest",
        "a push stands out of what is left elsewhere",
        "model_selection.external_pushes:_unrest",
        _always(1.0),
        ("model_selection.external_pushes:find_pushes",),
    ),
    Rule(
        "negligible-torque",
        "no cause below what a load makes negligible",
        "model_selection.cause_search:above_negligible",
        lambda model_fit, *_: list(model_fit.model),
    ),
    Rule(
        "significant",
        "numbers differ from no effect",
        "model_selection.cause_search:significant_terms",
        lambda model_fit, _: list(model_fit.model),
    ),
)

NAMING = (
    Rule(
        "weighed",
        "causes are weighed where they act",
        "model_selection.repeated_search:weighed_where_they_act",
        _given_with_none(0),
    ),
    Rule(
        "unconfirmed",
        "held-out recordings need the cause",
        "model_selection.repeated_search:without_unconfirmed",
        _given_with_none(0),
    ),
    Rule(
        "taken-up",
        "a cause is needed where links would take it up far off",
        "model_selection.naming:TAKEN_UP",
        INFINITE,
        ("model_selection.repeated_search:without_unconfirmed",),
    ),
    Rule(
        "motion", "the simulated motion does not reject the cause", "diagnose:rejected_by_motion", _always(())
    ),
    Rule(
        "correlation",
        "rivals: samples that follow each other count less",
        "model_selection.rivals:correlation_surplus",
        _always(1.0),
        ("model_selection.conclusion:judge_rivals",),
    ),
    Rule(
        "further-part",
        "rivals: a law's further part by itself",
        "model_selection.rivals:_alone",
        _always(False),
    ),
    Rule(
        "rival-open",
        "rivals: what cannot be told is left open",
        "model_selection.rivals:_open",
        _always(False),
    ),
)

VERDICT = (
    Rule(
        "tones",
        "tones and single moments are no noise",
        "model_selection.lack_of_fit:_tones_and_moments",
        _always(()),
        ("model_selection.lack_of_fit:find_structure",),
    ),
    Rule(
        "position",
        "a size that changes with the position is no noise",
        "model_selection.lack_of_fit:position_dependence",
        _always(None),
        ("model_selection.lack_of_fit:find_structure",),
    ),
    Rule(
        "quarter",
        "explained is a quarter at least",
        "model_selection.conclusion:EXPLAINED_MIN",
        0.0,
        ("model_selection.conclusion:verdict_of",),
    ),
    Rule("tolerance", "what is within 1 % of the range is small", "diagnose:set_small_aside", _given(0)),
)

RULES = (*ACCEPTANCE, *SEARCH, *NAMING, *VERDICT)


@dataclass(frozen=True)
class LeftOut:
    """Rules that are left out at once; mostly one.

    Attributes:
        rules: Which.
    """

    rules: tuple[Rule, ...]

    @property
    def name(self) -> str:
        """Of the row, and of the folder of answers."""
        return ",".join(rule.name for rule in self.rules)

    @property
    def does(self) -> str:
        """What a table says of them."""
        return self.rules[0].does if len(self.rules) == 1 else "all of these at once"


def rules_named(names: Sequence[str]) -> tuple[LeftOut, ...]:
    """Returns the rules of some names, all of them one by one for none; NAME,NAME are left out at once.

    Raises:
        ValueError: No rule has such a name.
    """
    known = {rule.name: rule for rule in RULES}
    groups = [name.split(",") for name in names] or [[name] for name in known]
    unknown = sorted({name for group in groups for name in group} - set(known))
    if unknown:
        every = ", ".join(known)
        raise ValueError(f"no rule has the name {', '.join(unknown)} (valid: {every})")
    return tuple(LeftOut(tuple(known[name] for name in group)) for group in groups)
