# SPDX-License-Identifier: BSD-3-Clause
"""Runs the command line on every case, as its user would, and keeps what it answers."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

LIMIT = 1800.0
"""Seconds after which a case counts as a crash."""


def cases(out: Path, block: str | None, count: int) -> list[str]:
    """Names of the cases of a block, or of all, in the order of their names."""
    found: dict[str, list[str]] = {}
    for path in sorted((out / "sealed").glob("*.json")):
        truth = json.loads(path.read_text())
        if block in (None, truth["block"]):
            found.setdefault(truth["block"], []).append(path.stem)
    return [name for names in found.values() for name in names[:count]]


def run_cases(out: Path, answers: Path, block: str | None, count: int, jobs: int) -> None:
    """Runs what has no answer yet, some side by side."""
    answers.mkdir(parents=True, exist_ok=True)
    due = [name for name in cases(out, block, count) if not (answers / f"{name}.exit.json").exists()]
    with ThreadPoolExecutor(jobs) as pool:
        for name, code, seconds in pool.map(lambda n: _run(out, answers, n), due):
            print(f"{name} exit {code}, {seconds:.0f} s", flush=True)


def _run(out: Path, answers: Path, name: str) -> tuple[str, int, float]:
    """One process; its JSON, its exit code and what it printed are kept."""
    folder = out / "cases" / name
    target = (answers / f"{name}.json").resolve()
    tool = Path(sys.executable).parent / "impedance"
    arguments = [
        str(tool),
        "diagnose",
        *json.loads((folder / "command.json").read_text()),
        "--json",
        str(target),
    ]
    begun = time.monotonic()
    try:
        done = subprocess.run(
            arguments, cwd=folder, capture_output=True, text=True, timeout=LIMIT, check=False
        )
        code, said = done.returncode, done.stdout + done.stderr
    except subprocess.TimeoutExpired:
        code, said = -1, f"no answer within {LIMIT:.0f} s"
    seconds = time.monotonic() - begun
    kept = {"exit": code, "seconds": round(seconds, 1), "said": said[-6000:]}
    (answers / f"{name}.exit.json").write_text(json.dumps(kept, indent=1))
    return name, code, seconds
