# SPDX-License-Identifier: BSD-3-Clause
"""The causes in the HTML report: how likely, where in the chain, with which numbers, and what they could be instead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impedance_modules.diagnosis.report.html_elements import (
    AFTER,
    bullets,
    drawing,
    new_figure,
    number,
    paragraph,
    percent,
    section,
    table,
    text,
)

PROBABLE = (
    "Probability: how likely this effect is present there, as often as such causes were true in simulated recordings"
    " with known truth. Weight: its part of the gap."
)

VERDICTS = {
    "helps": "In the simulated plant it improves the motion",
    "worsens": "In the simulated plant it worsens the motion, although it explains torque",
    "no difference": "In the simulated plant it makes no clear difference to the motion",
}

SHORT = 5
"""Causes that the head of a report lists."""

NORMAL_95 = 1.96
"""Standard deviations on either side that hold 95 % of a normal distribution."""

WIDE = 100.0
"""Half an interval, in % of the value, beyond which a number is not significantly different from zero and not drawn."""


def in_short(causes: Sequence[dict[str, Any]]) -> str:
    """One line per cause: place, size, uncertainty, and what it could be instead."""
    lines = [_line(cause) for cause in causes[:SHORT]]
    if len(causes) > SHORT:
        lines.append(f"and {len(causes) - SHORT} more")
    return bullets(lines)


def _line(cause: dict[str, Any]) -> str:
    numbers = "; ".join(
        f"{key}: "
        + ", ".join(f"{s} {number(e['value'])} ± {number(e['std'], 2)} {e['unit']}" for s, e in found.items())
        for key, found in cause["parameters"].items()
    )
    equal = ", ".join(f"{r['effect']} {' '.join(r['joints'])}" for r in cause["equivalent"])
    instead = f" - or instead: {equal}" if equal else ""
    return f"{cause['effect']} ({likely(cause)}, {percent(cause['weight'])} of the gap): {numbers}{instead}"


def likeliest(causes: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Causes by probability; equal ones, and those of files without it, by weight."""
    return sorted(causes, key=lambda cause: (-cause.get("probability", 0.0), -cause["weight"]))


def likely(cause: dict[str, Any]) -> str:
    """The probability in words; rounded down, so that none is called certain."""
    found = cause.get("probability")
    return "probability not known" if found is None else f"{int(100.0 * found)} % likely"


def cause_sections(causes: Sequence[dict[str, Any]], unexplained: float) -> str:
    """All causes in the order given; a sentence where there is none."""
    if not causes:
        return section("Causes", paragraph("None was found."))
    weights = [
        [
            _carriers(c), c["effect"], c["port"], c["place"].replace("_", " "), percent(c.get("probability")),
            percent(c["weight"]),
        ]
        for c in causes
    ]  # fmt: skip
    weights.append(["", "not explained", "", "", "", percent(unexplained)])
    names = ("on", "effect", "port", "place in the chain", "probability", "weight")
    head = table(names, weights, numbers=(4, 5))
    return section("Causes", paragraph(PROBABLE), head, *(_cause(cause) for cause in causes))


def small_section(causes: Sequence[dict[str, Any]], tolerance: float) -> str:
    """What was found within the tolerance; nothing where that is none."""
    if not causes:
        return ""
    words = (
        f"Within {percent(tolerance)} of each joint's torque range, and no change of the simulated motion."
    )
    return section("Too small to matter", paragraph(words), *(_cause(cause) for cause in likeliest(causes)))


def _carriers(cause: dict[str, Any]) -> str:
    return ", ".join(cause["joints"] or cause["parameters"])


def _cause(cause: dict[str, Any]) -> str:
    words = (
        f"{likely(cause).capitalize()}. At the {cause['port']} port{_elsewhere(cause)}; alone it shrinks the held-out"
        f" gap by {percent(cause['shrink'])}."
    )
    equal = [[r["effect"], ", ".join(r["joints"])] for r in cause["equivalent"]]
    lost = [[r["effect"], ", ".join(r["joints"]), r["lost_because"]] for r in cause["rivals"]]
    parts = [
        f"<h3>{text(cause['effect'])} on {text(_carriers(cause))}</h3>",
        paragraph(words),
        _parameters(cause["parameters"]),
        _ranges(cause["range"]),
        _rollout(cause["rollout"]),
    ]
    if equal:
        parts.append(paragraph("These recordings cannot distinguish it from:", "note"))
        parts.append(table(("effect", "joints"), equal))
    if lost:
        parts.append("<h4>Rivals, and why each was rejected</h4>")
        parts.append(table(("effect", "joints", "lost because"), lost))
    return "".join(parts)


def _elsewhere(cause: dict[str, Any]) -> str:
    """Other places that these recordings cannot tell from the named one; empty where there are none."""
    places = cause.get("other_places", [])
    if not places:
        return ""
    words = " or ".join([cause["place"], *places]).replace("_", " ")
    return f" (these recordings cannot tell whether it is at {words})"


def _parameters(parameters: dict[str, dict[str, dict[str, Any]]]) -> str:
    flat = [(f"{symbol} of {key}", e) for key, symbols in parameters.items() for symbol, e in symbols.items()]
    rows = [
        [name, number(e["value"], 5), *(number(x, 5) for x in _interval(e)), number(e["std"]), e["unit"]]
        for name, e in flat
    ]
    head = ("parameter", "value", "95 % from", "to", "std", "unit")
    return table(head, rows, numbers=(1, 2, 3, 4)) + _intervals(flat)


def _interval(estimate: dict[str, Any]) -> tuple[float, float]:
    reach = NORMAL_95 * float(estimate["std"])
    return estimate["value"] - reach, estimate["value"] + reach


def _intervals(flat: Sequence[tuple[str, dict[str, Any]]]) -> str:
    """Relative intervals, so that parameters of different units share one axis."""
    drawn = [(name, 100.0 * NORMAL_95 * e["std"] / abs(e["value"])) for name, e in flat if e["value"]]
    unsure = [name for name, e in flat if NORMAL_95 * e["std"] * 100.0 > WIDE * abs(e["value"])]
    note = paragraph(f"Not significantly different from zero: {', '.join(unsure)}.") if unsure else ""
    drawn = [(name, half) for name, half in drawn if np.isfinite(half) and half <= WIDE]
    if not drawn:
        return note
    figure = new_figure(5.5, 0.7 + 0.25 * len(drawn))
    axes = figure.subplots()
    for row, (_, half) in enumerate(drawn):
        axes.errorbar(0.0, row, xerr=half, fmt="o", color=AFTER, capsize=3, markersize=4)
    axes.axvline(0.0, color="black", linewidth=0.5)
    axes.set_yticks(range(len(drawn)), [name for name, _ in drawn], fontsize=8)
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    axes.set_xlabel("95 % interval, in % of the value", fontsize=8)
    return drawing(figure, "How well each parameter is known.") + note


def _ranges(ranges: dict[str, dict[str, list[float]]]) -> str:
    rows = [
        [joint, quantity, number(low), number(high)]
        for quantity, joints in ranges.items()
        for joint, (low, high) in joints.items()
    ]
    return table(("holds for", "of", "from", "to"), rows, numbers=(2, 3))


def _rollout(found: dict[str, Any] | None) -> str:
    if found is None:
        return paragraph("The rollouts of the plant do not show it.")
    words = (
        f"{VERDICTS[found['verdict']]}: error power {number(found['without'])} without it,"
        f" {number(found['with'])} with it, in units of the noise or of what all causes leave;"
        f" ratio {number(found['ratio'])}."
    )
    return paragraph(words, "note" if found["verdict"] == "worsens" else "")
