# SPDX-License-Identifier: BSD-3-Clause
"""The whole report: what was asked, how large the gap is, where, which causes, how far it shrinks, what is left."""

from __future__ import annotations

import json
from typing import Any

from impedance_modules.diagnosis.patch import patch_text
from impedance_modules.diagnosis.report.causes import cause_sections, in_short
from impedance_modules.diagnosis.report.html_elements import (
    bullets,
    number,
    paragraph,
    percent,
    section,
    table,
    text,
)
from impedance_modules.diagnosis.report.report_plots import bars, frequency_map, over_time, regime_map
from impedance_modules.diagnosis.report.rollouts import rollout_section
from impedance_modules.diagnosis.report.style import STYLE, VERDICT_COLOURS
from impedance_modules.diagnosis.result import Diagnosis

SENTENCES = {
    "no_gap": "Recordings and model agree within noise and the links' inertia tolerance.",
    "explained": "Recordings and model differ, and the causes below explain it.",
    "partly_explained": "Recordings and model differ; the causes below explain a part of it.",
    "unexplained": "Recordings and model differ, and nothing in the catalogue of effects explains it.",
    "ambiguous": "Recordings and model differ, and these recordings cannot tell some causes apart.",
    "insufficient_data": "The recordings do not suffice to tell.",
}

MOST_PLACES = 12
"""Places of the gap that a table lists; all of them are in the map and in the numbers."""


def html_report(found: Diagnosis, answer: dict[str, Any]) -> str:
    """Builds the report from the JSON object, so that every number in it is there; curves come from the diagnosis."""
    parts = [_head(answer), _data(answer["data"])]
    if found.series:
        parts += [_how_large(answer["gap"]), _where(answer)]
        parts.append(cause_sections(answer["causes"], answer["unexplained_weight"]))
        parts.append(section("Before and after, over time", over_time(found.series)))
        parts.append(rollout_section(answer["gap"]["rollout"], found.rollout.traces))
        parts.append(_left(answer["remainder"]))
    parts += [_next(answer["next_motion"]), _patch(answer["patch"]), _numbers(answer)]
    title = f"Diagnosis of {text(answer['robot'])}"
    view = "<meta name='viewport' content='width=device-width,initial-scale=1'>"
    top = f"<!doctype html><html lang='en'><head><meta charset='utf-8'>{view}<title>{title}</title>"
    return f"{top}<style>{STYLE}</style></head><body><h1>{title}</h1>{''.join(parts)}</body></html>\n"


def _head(answer: dict[str, Any]) -> str:
    verdict = answer["verdict"]
    colour, words = VERDICT_COLOURS[verdict], text(verdict.replace("_", " "))
    badge = f"<span class='badge' style='background:{colour}'>{words}</span>"
    first = answer["causes"][0] if answer["causes"] else None
    cards = [
        ("first cause", "none" if first is None else first["effect"]),
        ("on", "-" if first is None else ", ".join(first["joints"] or first["parameters"])),
        ("torque gap closed, held out", percent(answer["gap"]["shrink"])),
        ("motion gap closed, simulated", percent(answer["gap"]["rollout"].get("shrink"))),
    ]
    boxes = "".join(
        f"<div class='card'><span>{text(name)}</span><b>{text(value)}</b></div>" for name, value in cards
    )
    lead = paragraph(SENTENCES[verdict], "lead")
    return (
        f"<p>{badge}</p>{lead}<div class='cards'>{boxes}</div>{in_short(answer['causes'])}{_advice(answer)}"
    )


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
    nowhere = "" if where else paragraph("Nothing stands out of the noise.")
    return section("Where", nowhere, maps, listed)


def _left(remainder: dict[str, Any]) -> str:
    fits = "What remains is small enough." if remainder["explained"] else "What remains is not explained."
    lack = f"Largest residual power over noise: {number(remainder['lack_of_fit'])}."
    return section("What is left", paragraph(f"{fits} {lack}"), paragraph(remainder["structure"]))


def _next(motion: dict[str, Any]) -> str:
    rows = [
        [key.replace("_", " "), _plain(value)] for key, value in motion.items() if value not in ("", [], None)
    ]
    return section("What to record next", table(("", ""), rows))


def _plain(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _patch(patch: dict[str, Any] | None) -> str:
    if patch is None:
        return section(
            "Patch", paragraph("None: no effect shrank the held-out gap, or the verdict allows none.")
        )
    return section("Patch", f"<pre>{text(patch_text(patch))}</pre>")


def _numbers(answer: dict[str, Any]) -> str:
    body = text(json.dumps(answer, indent=1))
    return section(
        "The numbers", f"<details><summary>Everything, as JSON</summary><pre>{body}</pre></details>"
    )
