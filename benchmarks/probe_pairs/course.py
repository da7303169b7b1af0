# SPDX-License-Identifier: BSD-3-Clause
"""One pair from ambiguous to right, by the commands of a user: poor recordings, diagnosis, probe, run, diagnosis."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from click.testing import CliRunner

from benchmarks.probe_pairs.pairs import PairCase
from benchmarks.probe_pairs.poor_motions import record_poor, write_withheld
from benchmarks.probe_pairs.robot import NAME
from impedance_modules.cli.main import impedance
from impedance_modules.errors import ImpedanceError

MARK = b"impedance_modules"
"""Key of an episode's metadata."""

OPEN = ("both", "set", "refused")
"""Outcomes of a diagnosis that leave a question, so that a probe is asked for."""

REFUSED = 7
"""Exit code of a diagnosis whose data do not suffice."""


@dataclass(frozen=True)
class Answer:
    """What `impedance diagnose` said.

    Attributes:
        code: Its exit code.
        found: The diagnosis JSON; empty where it refused its input.
        said: What it printed in that case.
    """

    code: int
    found: dict[str, Any]
    said: str

    def outcome(self, case: PairCase) -> str:
        """One word for what it says of a case.

        ``both``: ambiguous, truth and partner in one set. ``set``: the truth is in a set without the partner.
        ``right``: the truth is the first cause and has no equivalent. ``later``: it is another cause, without
        equivalent. ``partner``: the partner, without the truth. ``other``: neither. ``nothing``: no cause.
        ``refused``: the data do not suffice.
        """
        if self.code == REFUSED or not self.found:
            return "refused"
        causes = self.found["causes"]
        if not causes:
            return "nothing"
        for rank, cause in enumerate(causes):
            names = {cause["effect"], *(other["effect"] for other in cause["equivalent"])}
            if case.truth.effect in names and len(names) > 1:
                return "both" if case.partner in names else "set"
            if cause["effect"] == case.truth.effect and case.truth.key in cause["parameters"]:
                return "later" if rank else "right"
        return "partner" if any(cause["effect"] == case.partner for cause in causes) else "other"

    def summary(self, case: PairCase) -> dict[str, Any]:
        """What is kept of it."""
        causes = [
            [
                c["effect"],
                list(c["parameters"]),
                [o["effect"] for o in c["equivalent"]],
                round(c["weight"], 3),
            ]
            for c in self.found.get("causes", ())
        ]
        kept = {"outcome": self.outcome(case), "verdict": self.found.get("verdict"), "causes": causes}
        return kept if self.found else kept | {"said": self.said}


def run_case(case: PairCase, robot: Path, folder: Path) -> dict[str, Any]:
    """Carries one case out, and returns what came of each stage.

    Args:
        case: The pair.
        robot: The robot's folder.
        folder: For its files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_withheld(folder, case.truth, NAME)
    began = time.process_time()
    done: dict[str, Any] = {"truth": case.truth.effect, "partner": case.partner, "sensor": case.torque_sensor}
    tried: dict[str, Any] = {}
    for motion in case.motions:
        poor = record_poor(folder, str(robot), case, motion)
        before = diagnose(case, robot, folder / "before.json", poor)
        tried[motion] = before.summary(case)
        if before.outcome(case) in OPEN:
            break
    done |= {"poor": tried, "before": before.outcome(case), "motion": motion}
    if done["before"] in OPEN:
        done |= _resolved(case, robot, folder, poor, before)
    return done | {"processor_seconds": round(time.process_time() - began, 1)}


def _resolved(
    case: PairCase, robot: Path, folder: Path, poor: Sequence[Path], before: Answer
) -> dict[str, Any]:
    """Makes the motion, records it, and asks again."""
    asked = [str(folder / "before.json")] if before.found else []
    code, said = command("probe", *asked, "--robot", str(robot), "--out", str(folder / "next"))
    if code:
        return {"probe": {"outcome": "refused", "said": said}}
    written = json.loads((folder / "next" / "probe.json").read_text())
    proposed = {
        "outcome": "proposed",
        "duration": round(written["duration_s"], 1),
        "motions": written["motions"],
        "questions": [[q["question"], q["answered"], q["reason"]] for q in written["questions"]],
    }
    run = ("run", str(folder / "next" / "probe.yaml"), "--effects", str(folder / "withheld.yaml"))
    code, said = command(*run, "--out", str(folder / "out"))
    recorded = folder / "out" / "episode.parquet"
    if not recorded.is_file():
        return {"probe": proposed, "run": {"exit": code, "said": said}}
    if not case.torque_sensor:
        recorded = _stripped(recorded, folder / "probed.parquet")
    after = diagnose(case, robot, folder / "after.json", [recorded, *poor])
    told = after.summary(case)
    return {"probe": proposed, "run": {"exit": code}, "told": told, "after": told["outcome"]}


def diagnose(case: PairCase, robot: Path, answer: Path, logs: Sequence[Path]) -> Answer:
    """Asks `impedance diagnose`."""
    answer.unlink(missing_ok=True)
    water = ("--under-water",) if case.under_water else ()
    words = ("diagnose", *map(str, logs), "--robot", str(robot), "--json", str(answer), *water)
    code, said = command(*words)
    found = json.loads(answer.read_text()) if answer.is_file() else {}
    return Answer(code, found, said)


def command(*words: str) -> tuple[int, str]:
    """Runs a verb in this process; exit code, and what it printed or why it refused."""
    try:
        done = CliRunner().invoke(impedance, list(words), standalone_mode=False, catch_exceptions=False)
    except ImpedanceError as error:
        return error.exit_code, str(error)
    return int(done.return_value or 0), done.output[-600:]


def _stripped(recorded: Path, path: Path) -> Path:
    """Writes a recording without its measured torques."""
    table = pq.read_table(recorded)
    about = json.loads(table.schema.metadata[MARK]) | {"effort_source": None}
    kept = table.select([name for name in table.column_names if not name.startswith("effort.")])
    pq.write_table(kept.replace_schema_metadata({MARK: json.dumps(about)}), path)
    return path
