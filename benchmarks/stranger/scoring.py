# SPDX-License-Identifier: BSD-3-Clause
"""Compares answers with the truth."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

SAME_PHYSICS: tuple[tuple[str, str, str], ...] = (
    (
        "payload",
        "link_inertia",
        "a thing fixed to a link is more mass of that link (effects.md: both are carried by it)",
    ),
    ("parallel_spring", "bench_spring", "effects.md: at the links the two are one law"),
)
"""Names of one physics at the same joint; either is taken, both ways."""

AT_FIRST_JOINTS: tuple[tuple[str, str, str], ...] = (
    ("reflected_inertia", "link_inertia", "diagnosis.md: rotors are equivalent to the links' inertia"),
)
"""One physics only at a joint before which nothing moves: its rotor is its link's moment about its axis.

(Documented as well: an encoder's offset of a first joint is a tilted base. No case here has one.)
"""

FIRST_JOINTS = {"panda_joint1", "shoulder_pan_joint", "j2s6s200_joint_1", "joint1"}

CONFIDENT = 0.9
ANSWERED = ("no_gap", "explained", "partly_explained", "unexplained", "ambiguous")


def wilson(right: int, count: int) -> str:
    """A share with its 95 % interval."""
    if count == 0:
        return "-"
    z, p = 1.96, right / count
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return f"{right}/{count} = {100 * p:.0f} % ({100 * (middle - half):.0f} to {100 * (middle + half):.0f})"


def matches(true: dict[str, Any], named: dict[str, Any]) -> bool:
    """Whether a name and its joints are what was planted.

    A push belongs to a link and has no joints; an effect of one joint on another names the joint that shows it, and
    both in its numbers (diagnosis.md).
    """
    if true["effect"] == named["effect"] == "external_contact":
        return True
    pairs = [set(key.split("<-")) for key in named.get("parameters", {}) if "<-" in key]
    if true["effect"] == named["effect"] and set(true["joints"]) in pairs:
        return True
    names = {true["effect"]}
    for one, two, _ in SAME_PHYSICS + (AT_FIRST_JOINTS if set(true["joints"]) <= FIRST_JOINTS else ()):
        if true["effect"] in (one, two):
            names |= {one, two}
    return named["effect"] in names and set(named["joints"]) == set(true["joints"])


def names_of(cause: dict[str, Any]) -> list[dict[str, Any]]:
    """A cause, and what the answer says cannot be told from it."""
    return [cause, *cause.get("equivalent", [])]


def judged(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, bool]:
    """What counts of one case, by its block."""
    causes, verdict = answer["causes"], answer["verdict"]
    if truth["block"] == "B":
        return {"no gap": verdict == "no_gap", "a cause named": bool(causes)}
    if truth["block"] == "E":
        sure = verdict == "explained" and any(c.get("probability", 1.0) >= CONFIDENT for c in causes)
        any_sure = any(c.get("probability", 1.0) >= CONFIDENT for c in causes)
        return {
            "nothing surely named": not sure,
            "seen": verdict != "no_gap",
            "no cause of 0.9 at any verdict": not any_sure,
        }
    within = [any(matches(t, n) for c in causes for n in names_of(c)) for t in truth["effects"]]
    plain = [any(matches(t, c) for c in causes) for t in truth["effects"]]
    out = {"within causes or equivalents": all(within), "all named as causes": all(plain)}
    if truth["block"] == "A":
        out["first cause right"] = bool(causes) and matches(truth["effects"][0], causes[0])
    out["explained"] = verdict == "explained"
    if truth["block"] == "C":
        out["one of two at least"] = any(within)
        out["nothing else named"] = all(
            any(matches(t, n) for t in truth["effects"] for n in names_of(c)) for c in causes
        )
    return out


def report(out: Path, answers: Path) -> str:
    """Figures by block, refusals and crashes apart, and a line for every case."""
    tallies: dict[str, Counter[str]] = {}
    counts: Counter[str] = Counter()
    failures: Counter[str] = Counter()
    lines: list[str] = []
    for path in sorted((out / "sealed").glob("*.json")):
        truth = json.loads(path.read_text())
        kept, found = answers / f"{path.stem}.exit.json", answers / f"{path.stem}.json"
        if not kept.exists():
            failures[truth["block"] + " not run"] += 1
            continue
        answer = json.loads(found.read_text()) if found.exists() else {"verdict": "none", "causes": []}
        if answer["verdict"] not in ANSWERED:
            failures[f"{truth['block']} {_why(json.loads(kept.read_text())['exit'])}"] += 1
            lines.append(f"{truth['block']} {path.stem} {_why(json.loads(kept.read_text())['exit'])}")
            continue
        result = judged(truth, answer)
        counts[truth["block"]] += 1
        tallies.setdefault(truth["block"], Counter()).update(k for k, yes in result.items() if yes)
        tallies[truth["block"]].update({k: 0 for k in result})
        lines.append(_line(truth, answer, result))
    return "\n".join([*sorted(lines), "", *_summary(tallies, counts, failures)])


def _why(code: int) -> str:
    return {2: "refused (exit 2)", 7: "data insufficient (exit 7)"}.get(code, f"crashed (exit {code})")


def _summary(tallies: dict[str, Counter[str]], counts: Counter[str], failures: Counter[str]) -> list[str]:
    lines = []
    for block in sorted(tallies):
        for what in sorted(tallies[block]):
            lines.append(f"{block}  {what:<32} {wilson(tallies[block][what], counts[block])}")
    return lines + [f"{what}: {count}" for what, count in sorted(failures.items())]


def _line(truth: dict[str, Any], answer: dict[str, Any], result: dict[str, bool]) -> str:
    planted = "; ".join(f"{e['effect']} {','.join(e['joints'])}" for e in truth["effects"]) or "clean"
    named = "; ".join(
        f"{c['effect']} {','.join(c['joints'])} {c.get('probability', 1):.2f}" for c in answer["causes"]
    )
    right = ", ".join(k for k, yes in result.items() if yes) or "nothing"
    return f"{truth['block']} {truth['case']}: {planted} -> {answer['verdict']}: {named or '-'} [{right}]"
