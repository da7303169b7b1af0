# SPDX-License-Identifier: BSD-3-Clause
"""The HTML report: data, size and place of the gap, causes with rivals and rollouts, remainder, next motion, patch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impedance_modules.diagnosis.report.diagnosis_files import why_no_patch
from impedance_modules.diagnosis.report.html_causes import (
    cause_sections,
    in_short,
    likeliest,
    small_section,
)
from impedance_modules.diagnosis.report.html_elements import (
    STYLE,
    VERDICT_COLOURS,
    bullets,
    command_lines,
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

HOW_LARGE = (
    "After: with the named causes alone, as the patch has them. Refitted: with links, weights and stamps too, as fitted"
    " beside them within their stated deviations; no patch holds those."
)

SWALLOWED = (
    "Masses, inertias and stamps are not known exactly; within a stated deviation the fit may change them, and that is"
    " no finding."
)


MOST_PLACES = 12
"""Places of the gap that a table lists; all of them are in the map and in the JSON."""


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
        parts.append(_patch(answer["patch"], found))
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
        ("with links and stamps refitted", percent(answer["gap"].get("refitted_shrink"))),
        ("motion gap closed, simulated", percent(answer["gap"]["rollout"].get("shrink"))),
    ]
    boxes = "".join(
        f"<div class='card'><span>{text(name)}</span><b>{text(value)}</b></div>" for name, value in cards
    )
    lead = paragraph(SENTENCES[verdict], "lead")
    return f"<p>{badge}</p>{lead}<div class='cards'>{boxes}</div>{in_short(causes)}{_advice(answer)}"


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
        [g["joint"], g["residual"], *(number(g[key]) for key in ("before", "after", "refitted", "noise_floor")),
         g["unit"], percent(g["shrink"])]
        for g in gap["per_port"]
    ]  # fmt: skip
    head = ("joint", "residual", "before", "after", "refitted", "noise", "unit", "shrink")
    listed = table(head, rows, numbers=(2, 3, 4, 5, 7))
    return section("How large", paragraph(HOW_LARGE), bars(gap["per_port"]), listed)


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


def _patch(patch: dict[str, Any] | None, found: Diagnosis) -> str:
    """What a patch holds, effect by effect; a sentence where there is none."""
    if patch is None:
        return section("Patch", paragraph(f"None: {why_no_patch(found)}."))
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
