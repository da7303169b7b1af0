# SPDX-License-Identifier: BSD-3-Clause
"""Carries tasks out on the built-in plant and on MuJoCo, and diagnoses recordings of each with the same model.

Usage: python -m benchmarks.backends.two_realities [tasks | speed | diagnosis] ...

``tasks``: how far the hands of the two realities are apart, and the phases. ``speed``: how fast a whole run on MuJoCo
is, files included, against the clock. ``diagnosis``: what ``diagnose`` names in recordings of one motion twice and of
another, held out, at 500 Hz; without effects, with effects that the robot on MuJoCo has and the model does not know,
and with a model of the robot whose joints are rigid, as those of most MuJoCo models are. A minute or two per case.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
TASKS = (
    *("reach-and-return", "mirrored-arms", "hand-over-hand", "touch-and-stop", "wipe-table"),
    *("hold-to-pipe", "turn-lever", "box-hold", "press-box", str(DATA / "fr3-box.yaml")),
)
"""Free motion first, then with contact, a hinge and held objects."""

SPEED_TASKS = ("wipe-table", "press-box")
MOTIONS = ("swing-one", "swing-one", "swing-two")
RATE = 500

EFFECTS = {
    "viscous_friction": ("actuator", "fv: {value: 2.0, unit: N.m.s/rad}"),
    "coulomb_friction": ("actuator", "fc: {value: 0.8, unit: N.m}"),
    "reflected_inertia": ("actuator", "Ia: {value: 0.9, unit: kg.m^2}"),
}
"""What the robot on MuJoCo has at ``JOINT`` beyond the model, which has 0.7 N.m.s/rad, none, and 0.6 kg.m^2 there."""

JOINT = "right_e1"


def impedance(*words: object, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs a verb in a process of its own."""
    command = [sys.executable, "-m", "impedance_modules", *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def recorded(task: str, backend: str, out: Path, *more: object) -> tuple[Episode, dict, float]:
    """Runs a task; returns the recording, the summary and the seconds that it took, the program's start included."""
    began = time.perf_counter()
    done = impedance("run", task, "--backend", backend, "--out", out, *more)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{task} on {backend}: {done.stderr}")
    return read_episode(out), json.loads((out / "summary.json").read_text()), time.perf_counter() - began


def compare(folder: Path) -> None:
    """Prints hands and phases of every task."""
    print("| task | hands apart, RMS | at most | phases in the same order | tank, lowest: plant, MuJoCo |")
    print("|---|---|---|---|---|")
    for words in TASKS:
        task, *more = words.split()
        name = " ".join((Path(task).stem, *more))
        (plant, one, _), (mujoco, other, _) = (
            recorded(task, backend, folder / name / backend, *more) for backend in ("sim", "mujoco")
        )
        rows = min(len(plant), len(mujoco))
        away = [
            np.linalg.norm(plant.pose[hand][:rows, :3] - mujoco.pose[hand][:rows, :3], axis=1)
            for hand in plant.pose
        ]
        same = [p["name"] for p in one["phases"]] == [p["name"] for p in other["phases"]]
        rms, most = max(np.sqrt(np.mean(a**2)) for a in away), max(a.max() for a in away)
        tanks = ", ".join(f"{summary['tank']['lowest']:.2f}" for summary in (one, other))
        print(
            f"| {name} | {1e3 * rms:.2f} mm | {1e3 * most:.2f} mm | {'yes' if same else 'no'} | {tanks} J |"
        )


def measure_speed(folder: Path) -> None:
    """Prints how much faster than real time a run is, from the assembled task to its files; the best of three."""
    from impedance_modules.control.assembly import assemble
    from impedance_modules.runs.execution import RunOptions, carry_out, draw_run
    from impedance_modules.runs.run_backends import make_backend

    print(
        "| all files written, the picture apart | times real time, by the clock | by processor time of all threads |"
    )
    print("|---|---|---|")
    for task in SPEED_TASKS:
        for backend in ("sim", "mujoco"):
            elapsed, busy = [], []
            for attempt in range(3):
                assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
                robot = make_backend(assembly, backend=backend, log=None, seed=0)
                out = folder / f"{task}-{backend}-{attempt}"
                options = RunOptions(out, 0, None, live=False, read_only=False, backend=backend)
                began, used = time.perf_counter(), time.process_time()
                result = carry_out(assembly, robot, options, lambda *_: None)
                ended, busy_at_end = time.perf_counter(), time.process_time()
                draw_run(out)
                # The picture is drawn once in the run as well, and counted apart.
                elapsed_for = 2.0 * ended - began - time.perf_counter()
                used_for = 2.0 * busy_at_end - used - time.process_time()
                lasted = float(result.summary["duration"])
                elapsed.append(lasted / elapsed_for)
                busy.append(lasted / used_for)
            print(
                f"| {task} on {backend} | {max(elapsed):.1f} | {max(busy):.1f} |",
                flush=True,
            )


def patch_text(effect: str) -> str:
    """Writes a case as a patch."""
    port, numbers = EFFECTS[effect]
    return (
        'format: 1\nrobot: baxter\nprovenance: {origin: hand, date: "2026-11-23", note: Withheld.}\n'
        f"effects: [{{effect: {effect}, joints: [{JOINT}], port: {port}, parameters: {{{JOINT}: {{{numbers}}}}}}}]\n"
    )


def motions(backend: str, folder: Path, patch: Path | None) -> list[Path]:
    """Records the three motions."""
    effects = () if patch is None else ("--effects", patch)
    for seed, motion in enumerate(MOTIONS):
        out = folder / f"motion{seed}"
        recorded(str(DATA / f"{motion}.yaml"), backend, out, "--rate", RATE, "--seed", seed, *effects)
    return [folder / f"motion{seed}" for seed in range(len(MOTIONS))]


def rigid_robot(folder: Path) -> Path:
    """Writes the robot's folder once more, its joints without springs; returns the folder to work in."""
    robot = folder / "robots" / "rigid-baxter"
    shutil.copytree(ROOT / "robots" / "baxter", robot)
    text = (robot / "robot.yaml").read_text()
    text = re.sub(r"(?m)^name: .*$", "name: rigid-baxter", text, count=1)
    for key, value in (("spring_stiffness", "rigid"), ("spring_damping", "0")):
        joints = ", ".join(f"{short}: {value}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))
        text = re.sub(rf"(?m)^  {key}: .*$", f"  {key}: {{{joints}}}", text)
    (robot / "robot.yaml").write_text(text)
    return folder


def diagnosed(logs: list[Path], robot: str, folder: Path) -> str:
    """Diagnoses three recordings; returns the verdict and the causes in words."""
    answer = folder / f"{Path(robot).name}.json"
    *known, held_out = logs
    impedance("diagnose", *known, "--holdout", held_out, "--robot", robot, "--json", answer, folder=folder)
    found = json.loads(answer.read_text())
    causes = []
    for cause in found["causes"]:
        numbers = [
            f"{key} {symbol} = {n['value']:.3g} +- {n['std']:.2g} {n['unit']}"
            for key, values in cause["parameters"].items()
            for symbol, n in values.items()
        ]
        causes.append(f"{cause['effect']} ({'; '.join(numbers)})")
    return f"{found['verdict']} | {', '.join(causes) or '-'}"


def diagnose_all(folder: Path) -> None:
    """Prints what is named for each reality."""
    print("| recorded on | model | verdict | causes |")
    print("|---|---|---|---|")
    for backend in ("sim", "mujoco"):
        place = folder / backend
        place.mkdir()
        logs = motions(backend, place, None)
        print(f"| {backend} | baxter | {diagnosed(logs, 'baxter', place)} |", flush=True)
        found = diagnosed(logs, "robots/rigid-baxter", rigid_robot(place))
        print(f"| {backend} | baxter, joints rigid | {found} |", flush=True)
    for effect, (_, numbers) in EFFECTS.items():
        place = folder / effect
        place.mkdir()
        patch = place / "withheld.yaml"
        patch.write_text(patch_text(effect))
        found = diagnosed(motions("mujoco", place, patch), "baxter", place)
        print(f"| mujoco with {effect}, {JOINT} {numbers} | baxter | {found} |", flush=True)


PARTS = {"tasks": compare, "speed": measure_speed, "diagnosis": diagnose_all}


def main() -> None:
    """Runs the parts that are asked for, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    for part in parser.parse_args().parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            PARTS[part](Path(folder))


if __name__ == "__main__":
    main()
