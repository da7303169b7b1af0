# SPDX-License-Identifier: BSD-3-Clause
"""The HTML report: data, size and place of the gap, causes with rivals and rollouts, remainder, next motion, patch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impedance_modules.diagnosis.report.html_elements import (
    AFTER,
    STYLE,
    VERDICT_COLOURS,
    bullets,
    command_lines,
    drawing,
    new_figure,
    number,
    paragraph,
    percent,
    section,
    table,
    text,
)
from impedance_modules.diagnosis.report.report_plots import (
    bars,
    frequency_map,
    over_time,
    regime_map,
    rollout_section,
)
from impedance_modules.diagnosis.report.sentences import swallowed_sentences
from impedance_modules.diagnosis.report.zoom import HINT, SCRIPT, policy
from impedance_modules.diagnosis.result import Diagnosis

SENTENCES = {
    "no_gap": "Recordings and model agree within noise and the links' inertia tolerance.",
    "explained": "Recordings and model differ, and the causes below explain it.",
    "partly_explained": "Recordings and model differ; the causes below explain a part of it.",
    "unexplained": "Recordings and model differ, and nothing in the catalogue of effects explains it.",
    "ambiguous": "Recordings and model differ, and these recordings cannot tell some causes apart.",
    "insufficient_data": "The recordings do not suffice to tell.",
}

SEEN = (
    "The noise is what each comparison cannot see below: a torque that is several times larger and follows the motion"
    " would have been found."
)

SWALLOWED = (
    "Masses, inertias and stamps are not known exactly; within a stated deviation the fit may change them, and that is"
    " no finding."
)

PROBABLE = (
    "Probability: how likely this effect is present there, as often as such causes were true in simulated recordings"
    " with known truth. Weight: its part of the gap."
)

MOST_PLACES = 12
"""Places of the gap that a table lists; all of them are in the map and in the JSON."""

NORMAL_95 = 1.96
"""Standard deviations on either side that hold 95 % of a normal distribution."""

VERDICTS = {
    "helps": "In the simulated plant it improves the motion",
    "worsens": "In the simulated plant it worsens the motion, although it explains torque",
    "no difference": "In the simulated plant it makes no clear difference to the motion",
}

SHORT = 5
"""Causes that the head of a report lists."""

WIDE = 100.0
"""Half an interval, in % of the value, beyond which a number is not significantly different from zero and not drawn."""


def html_report(found: Diagnosis, answer: dict[str, Any], commands: Sequence[str] = ()) -> str:
    """Builds the report from the JSON object, so that every number in it is there; curves come from the diagnosis.

    Args:
        found: The diagnosis.
        answer: Its JSON object.
        commands: What to type in order to record and use the next motion.
    """
    parts = _calm(found, answer) if answer["verdict"] == "no_gap" else _findings(found, answer)
    parts.append(_next(answer["next_motion"], commands))
    if answer["verdict"] != "no_gap":
        parts.append(_patch(answer["patch"]))
    title = f"Diagnosis of {text(answer['robot'])}"
    view = "<meta name='viewport' content='width=device-width,initial-scale=1'>"
    top = f"<!doctype html><html lang='en'><head><meta charset='utf-8'>{policy()}{view}<title>{title}</title>"
    drawn = any("<svg" in part for part in parts)
    hint, script = (paragraph(HINT, "hint"), f"<script>{SCRIPT}</script>") if drawn else ("", "")
    body = f"<h1>{title}</h1>{parts[0]}{hint}{''.join(parts[1:])}"
    return f"{top}<style>{STYLE}</style></head><body>{body}{script}</body></html>\n"


def _findings(found: Diagnosis, answer: dict[str, Any]) -> list[str]:
    """Sections of a diagnosis with a gap, or without enough data."""
    parts = [_head(answer), _data(answer["data"])]
    if found.series:
        parts += [_how_large(answer["gap"]), _where(answer)]
        parts.append(cause_sections(likeliest(answer["causes"]), answer["unexplained_weight"]))
        parts.append(small_section(answer["small"], answer["tolerance"]))
        parts.append(swallowed_section(answer["swallowed"]))
        parts.append(section("Before and after, over time", over_time(found.series)))
        parts.append(rollout_section(answer["gap"]["rollout"], found.rollout.traces))
        parts.append(_left(answer["remainder"]))
    return parts


def _calm(found: Diagnosis, answer: dict[str, Any]) -> list[str]:
    """Sections where nothing is wrong: what was looked at, how much would have been seen, and what is small."""
    gap, rollout = answer["gap"], answer["gap"]["rollout"]
    joints = list(dict.fromkeys(g["joint"] for g in gap["per_port"]))
    looked = (
        f"{_count(len(answer['data']['episodes']), 'recording')} of {_count(len(joints), 'joint')} were compared with"
        " the model: nothing differs by more than noise, the links' stated tolerance, and what is too small to matter."
    )
    head = (
        f"<div class='calm'><p class='badge' style='background:{VERDICT_COLOURS['no_gap']}'>no gap</p>"
        f"<p class='lead'>Nothing is wrong.</p>{paragraph(looked)}</div>"
    )
    rows = [
        [g["joint"], g["residual"], *(number(g[key]) for key in ("after", "noise_floor")), g["unit"]]
        for g in gap["per_port"]
    ]
    seen = table(("joint", "residual", "what is left", "noise", "unit"), rows, numbers=(2, 3))
    parts = [head, section("What would have been seen", paragraph(SEEN), seen)]
    parts.append(small_section(answer["small"], answer["tolerance"]))
    parts.append(swallowed_section(answer["swallowed"]))
    if found.series:
        parts.append(section("What is left, over time", over_time(found.series)))
    if rollout["windows"]:
        parts.append(rollout_section(rollout, found.rollout.traces))
    parts.append(_data(answer["data"]))
    return parts


def _count(number_of: int, word: str) -> str:
    return f"{number_of} {word}{'' if number_of == 1 else 's'}"


def swallowed_section(swallowed: dict[str, Any] | None) -> str:
    """What was fitted within priors; nothing without a fit."""
    if swallowed is None:
        return ""
    said = swallowed_sentences(swallowed)
    words = paragraph(SWALLOWED if said else f"{SWALLOWED} They took up less than one deviation here.")
    rows = [
        [name, number(a["mass"]), a["unit"], number(a["deviations"])]
        for name, a in swallowed["links"].items()
    ]
    rows += [
        [f"{kind}, stamped later", number(a["later"]), a["unit"], number(a["deviations"])]
        for kind, a in swallowed["times"].items()
    ]
    listed = table(("link, or stamp", "change", "unit", "deviations"), rows, numbers=(1, 3))
    return section("What the stated deviations took up", words, bullets(said), listed)


def _head(answer: dict[str, Any]) -> str:
    verdict = answer["verdict"]
    colour, words = VERDICT_COLOURS[verdict], text(verdict.replace("_", " "))
    badge = f"<span class='badge' style='background:{colour}'>{words}</span>"
    causes = likeliest(answer["causes"])
    first = causes[0] if causes else None
    cards = [
        ("likeliest cause", "none" if first is None else first["effect"]),
        ("on", "-" if first is None else ", ".join(first["joints"] or first["parameters"])),
        ("torque gap closed, held out", percent(answer["gap"]["shrink"])),
        ("motion gap closed, simulated", percent(answer["gap"]["rollout"].get("shrink"))),
    ]
    boxes = "".join(
        f"<div class='card'><span>{text(name)}</span><b>{text(value)}</b></div>" for name, value in cards
    )
    lead = paragraph(SENTENCES[verdict], "lead")
    return f"<p>{badge}</p>{lead}<div class='cards'>{boxes}</div>{in_short(causes)}{_advice(answer)}"


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


def _advice(answer: dict[str, Any]) -> str:
    """What to record next, in a sentence; nothing where nothing is needed."""
    motion = answer["next_motion"]
    if motion.get("purpose", "none needed") in ("", "none needed"):
        return ""
    return paragraph(f"Next: to {motion['purpose']}: {motion.get('excitation', '')}.")


def _data(data: dict[str, Any]) -> str:
    held = set(data["heldout"])
    rows = [
        [name, "held out" if name in held else "fitted", number(rates.get(name)), _jitter(jitter.get(name))]
        for rates, jitter in [(data.get("rate_hz", {}), data.get("jitter", {}))]
        for name in data["episodes"]
    ]
    facts = [
        *([data["reason"]] if "reason" in data else []),
        *([f"Torque: {data['torque']}."] if "torque" in data else []),
        *(
            ["Repeats: " + "; ".join(", ".join(group) for group in data["repeats"])]
            if data.get("repeats")
            else []
        ),
        *(["Hardly moved: " + ", ".join(data["weak_joints"])] if data.get("weak_joints") else []),
        *(
            [f"Effort lags the command by {number(data['delay_s'])} s."]
            if data.get("delay_s") is not None
            else []
        ),
    ]
    warned = "".join(paragraph(warning, "note") for warning in data.get("warnings", []))
    listed = table(("recording", "role", "rate [Hz]", "jitter of the step"), rows, numbers=(2, 3))
    return section("The data", bullets(facts), warned, listed)


def _jitter(share: float | None) -> str:
    """Jitter in % of the step, without the rounding of the stamps themselves."""
    return percent(None if share is None else round(share, 4))


def _how_large(gap: dict[str, Any]) -> str:
    rows = [
        [g["joint"], g["residual"], *(number(g[key]) for key in ("before", "after", "noise_floor")), g["unit"],
         percent(g["shrink"])]
        for g in gap["per_port"]
    ]  # fmt: skip
    head = ("joint", "residual", "before", "after", "noise", "unit", "shrink")
    return section("How large", bars(gap["per_port"]), table(head, rows, numbers=(2, 3, 4, 6)))


def _where(answer: dict[str, Any]) -> str:
    where, gap = answer["where"], answer["gap"]
    maps = regime_map(where) + frequency_map(gap["spectrum"], gap["per_port"])
    rows = [
        [p["joint"], p["port"], p["regime"].replace("_", " "), f"{p['band_hz'][0]:.3g} to {p['band_hz'][1]:.3g}",
         percent(p["share"])]
        for p in where[:MOST_PLACES]
    ]  # fmt: skip
    listed = table(("joint", "port", "regime", "band [Hz]", "share"), rows, numbers=(3, 4))
    nowhere = "" if where else paragraph("Nothing exceeds the noise.")
    return section("Where", nowhere, maps, listed)


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


def _left(remainder: dict[str, Any]) -> str:
    fits = "What remains is small enough." if remainder["explained"] else "What remains is not explained."
    lack = f"Largest residual power over noise: {number(remainder['lack_of_fit'])}."
    return section("What is left", paragraph(f"{fits} {lack}"), paragraph(remainder["structure"]))


def _next(motion: dict[str, Any], commands: Sequence[str]) -> str:
    """The motion in words, its start as a table, and the commands; a sentence where none is needed."""
    if motion.get("purpose", "none needed") in ("", "none needed"):
        return section("What to record next", paragraph("Nothing is needed."))
    joints = ", ".join(motion.get("joints", []))
    rows = [["to", motion["purpose"]], ["joints", joints], ["motion", motion.get("excitation", "")]]
    start = [[joint, number(position)] for joint, position in motion.get("start", {}).items()]
    return section(
        "What to record next",
        table(("", ""), [row for row in rows if row[1]]),
        table(("start about", "position"), start, numbers=(1,)),
        paragraph("Commands that make this motion, and use it:") if commands else "",
        command_lines(commands),
    )


def _patch(patch: dict[str, Any] | None) -> str:
    """What a patch holds, effect by effect; a sentence where there is none."""
    if patch is None:
        return section(
            "Patch", paragraph("None: no effect shrank the held-out gap, or the verdict allows none.")
        )
    rows = [
        [effect["effect"], key, effect["port"], symbol, number(e["value"], 5), e["unit"]]
        for effect in patch["effects"]
        for key, symbols in effect["parameters"].items()
        for symbol, e in symbols.items()
    ]
    words = (
        "Applied to plant and model by `run --effects` and `diagnose --effects`; --patch F.yaml writes it."
    )
    head = ("effect", "on", "port", "symbol", "value", "unit")
    return section("Patch", paragraph(words), table(head, rows, numbers=(4,)))


def _cause(cause: dict[str, Any]) -> str:
    words = (
        f"{likely(cause).capitalize()}. At the {cause['port']} port; alone it shrinks the held-out gap by"
        f" {percent(cause['shrink'])}."
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
