# SPDX-License-Identifier: BSD-3-Clause
"""Made-up truth, one case per block, with a tool that is always right and one that is always wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.blind.generate import SEALED, SEALS, seal_of
from benchmarks.blind.run import ANSWERS

TRUE: dict[str, Any] = {
    "effect": "viscous_friction",
    "joints": ["left_e1"],
    "port": "actuator",
    "parameters": {"left_e1": {"fv": 2.0}},
    "also": [],
    "size": 3.0,
    "size_with_inertias": 3.0,
}
CAUSE = {
    "effect": "viscous_friction",
    "joints": ["left_e1"],
    "parameters": {"left_e1": {"fv": {"value": 2.02, "std": 0.05, "unit": "N.m.s/rad"}}},
    "equivalent": [],
}
WRONG = {"effect": "backlash", "joints": ["left_w2"], "parameters": {}, "equivalent": []}
SECOND = {**TRUE, "effect": "torque_offset", "parameters": {"left_e1": {"c": 1.0}}}

BENCH = {"noise_level": 1.0, "inertia_error": 0.01, "side": "left"}

Case = tuple[dict[str, Any], str, list[dict[str, Any]]]


def pretend(out: Path) -> None:
    """Writes truths, seals and the answers of both tools below ``out``."""
    for block, cases in _cases().items():
        sealed = out / SEALED / f"{block}.json"
        sealed.parent.mkdir(parents=True, exist_ok=True)
        truths = {f"{block}{i}": {"block": block, **BENCH, **truth} for i, (truth, _, _) in enumerate(cases)}
        sealed.write_text(json.dumps({"cases": truths}))
        with (out / SEALS).open("a") as file:
            file.write(f"{seal_of(sealed)}  {SEALED}/{block}.json  dev  {len(cases)} cases\n")
        for i, (_, verdict, causes) in enumerate(cases):
            _answer(out / ANSWERS / "impedance", f"{block}{i}", verdict, causes)
            _answer(out / ANSWERS / "least-squares", f"{block}{i}", "explained", [WRONG])


def _cases() -> dict[str, list[Case]]:
    pair = ["viscous_friction", "coulomb_friction"]
    both = [{**CAUSE, "equivalent": [{"effect": "coulomb_friction", "joints": ["left_e1"]}]}]
    other = {**CAUSE, "effect": "torque_offset", "parameters": {}}
    strange = {**TRUE, "effect": "vibration_tone", "parameters": {}}
    return {
        "A": [({"effects": [TRUE]}, "explained", [CAUSE])],
        "B": [({"effects": []}, "no_gap", [])],
        "C": [({"effects": [TRUE, SECOND]}, "explained", [CAUSE, other])],
        "D": [
            ({"effects": [TRUE], "motion": "poor", "pair": pair, "apart": 1.0}, "ambiguous", both),
            ({"effects": [TRUE], "motion": "rich", "pair": pair, "apart": 500.0}, "explained", [CAUSE]),
        ],
        "E": [({"effects": [strange]}, "unexplained", [])],
        "F": [({"effects": [TRUE]}, "partly_explained", [WRONG])],
        "N": [({"effects": [TRUE]}, "explained", [CAUSE])],
        "G": [({"effects": [TRUE]}, "explained", [CAUSE]), ({"effects": []}, "no_gap", [])],
    }


def _answer(folder: Path, name: str, verdict: str, causes: list[dict[str, Any]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.json").write_text(
        json.dumps({"verdict": verdict, "causes": causes, "gap": {"shrink": 0.97}})
    )
    run = {"exit": 0, "seconds": 1.0, "processor_seconds": 1.0, "memory_mb": 200.0, "errors": ""}
    (folder / f"{name}.run.json").write_text(json.dumps(run))
