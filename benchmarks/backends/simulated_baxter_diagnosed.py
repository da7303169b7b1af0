# SPDX-License-Identifier: BSD-3-Clause
"""Gives the simulated Baxter effects that neither task nor model know, records it, and prints what ``diagnose`` names.

Usage: python -m benchmarks.backends.simulated_baxter_diagnosed [CASE ...]

In process and in lock-step, as fast as the machine allows: two recordings of one motion of the right arm, one of
another, held out, at 200 Hz. About a minute of processor time per case. The spring is diagnosed without the recorded
commands, as ``impedance baxter record`` has none: this robot compensates it, so only the joints' sensors see it. In the
case ``nothing`` it has no effect.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as pq

from impedance_modules.control.assembly import assemble
from tests.support.baxter_lockstep import run_in_lockstep

TASKS = Path(__file__).parents[2] / "tests" / "data"
RATE = 200.0
NOTHING = "nothing"
MOTIONS = ("swing-one", "swing-one", "swing-two")

CASES = {
    "viscous_friction": ("right_e1", "actuator", "fv: {value: 2.0, unit: N.m.s/rad}"),
    "reflected_inertia": ("right_w1", "actuator", "Ia: {value: 0.25, unit: kg.m^2}"),
    "torque_gain": ("right_s0", "actuator", 's: {value: 0.7, unit: "1"}'),
    "parallel_spring": (
        "right_e1",
        "link",
        "k: {value: 8.0, unit: N.m/rad}, preload: {value: 8.0, unit: N.m}",
    ),
}
"""Effect -> joint, port, numbers. The model has I_r = 0.044 kg.m^2 at right_w1, and none of the others."""


def patch_text(effect: str) -> str:
    """Writes a case as a patch."""
    joint, port, numbers = CASES[effect]
    return (
        'format: 1\nrobot: baxter\nprovenance: {origin: hand, date: "2026-11-21", note: Withheld.}\n'
        f"effects: [{{effect: {effect}, joints: [{joint}], port: {port}, parameters: {{{joint}: {{{numbers}}}}}}}]\n"
    )


def recordings(effect: str, folder: Path) -> list[Path]:
    """Runs the motions on a simulated Baxter with the effect of the case."""
    patch = folder / "withheld.yaml"
    if effect != NOTHING:
        patch.write_text(patch_text(effect))
    found = []
    for number, motion in enumerate(MOTIONS):
        task = str(TASKS / f"{motion}.yaml")
        assembly = assemble(task, effects=None, rate=RATE, scale=1.0, arm=None)
        out = folder / f"{effect}-{number}"
        effects = None if effect == NOTHING else patch
        run_in_lockstep(assembly, out, effects=effects, seed=number, springs={})
        found.append(without_commands(out, folder) if effect == "parallel_spring" else out)
    return found


def without_commands(run: Path, folder: Path) -> Path:
    """Keeps of a run what a bare recording has."""
    table = pq.read_table(run / "episode.parquet")
    kinds = ("time", "position", "velocity", "effort")
    bare = table.select([name for name in table.column_names if name.partition(".")[0] in kinds])
    path = folder / f"{run.name}.parquet"
    pq.write_table(bare, path)
    return path


def diagnose(found: list[Path], folder: Path) -> str:
    """Asks ``impedance diagnose``; the last recording is held out."""
    answer = folder / "answer.json"
    logs = [*map(str, found[:-1]), "--holdout", str(found[-1])]
    command = [sys.executable, "-m", "impedance_modules", "diagnose", *logs, "--robot", "baxter"]
    run = subprocess.run([*command, "--json", str(answer)], capture_output=True, text=True, check=False)
    if not answer.is_file():
        return f"exit {run.returncode}: {run.stderr.strip()}"
    said = json.loads(answer.read_text())
    lines = [said["verdict"]]
    for cause in said["causes"][:2]:
        numbers = {
            key: {symbol: f"{q['value']:.3g} +- {q['std']:.2g}" for symbol, q in symbols.items()}
            for key, symbols in cause["parameters"].items()
        }
        joints = ", ".join(cause["joints"])
        lines.append(
            f"{cause['effect']} on {joints}, {cause['port']}: weight {cause['weight']:.2f} {numbers}"
        )
    return "\n  ".join(lines)


def main() -> None:
    """Prints one block per case."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join((NOTHING, *CASES)))
    known = (NOTHING, *CASES)
    wanted = parser.parse_args().cases or known
    unknown = [name for name in wanted if name not in known]
    if unknown:
        parser.error(f"no case {', '.join(unknown)} (valid: {', '.join(known)})")
    for effect in wanted:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            print(
                f"{effect} {CASES.get(effect, '')}:\n  {diagnose(recordings(effect, folder), folder)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
