# SPDX-License-Identifier: BSD-3-Clause
"""What compensating a diagnosed effect gains, and how well a patch repeats the recordings it came from.

Usage: python -m benchmarks.compensation [--seeds N] [--out DIR] [--exact] [EFFECT ...]
       python -m benchmarks.compensation --table [--out DIR]

For every effect that a controller can compensate, and every seed: a Baxter whose plant has the effect, with numbers
drawn from the seed, is recorded in three motions of joint springs; ``impedance diagnose`` writes a patch; then a task
of another kind, which sways, presses and slides, is run four times: without the effect, with it, with it compensated
as diagnosed, and with the diagnosed patch in place of the effect. ``--exact`` leaves the diagnosis out: the effect's
own numbers are compensated, which shows what compensation by itself leaves. A finished case is kept in DIR and not
run again. ``--table`` prints the cases in DIR as the table of docs/compensation.md. About 90 s of processor time per
case, 15 s with ``--exact``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.errors import BadInput
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.run_backends import make_backend
from impedance_modules.runs.task_plant import sim_backend

MOTIONS = Path(__file__).parents[1] / "tests" / "data"
RECORDED = ("swing-one", "swing-one", "swing-two")
RATE = 200.0
PRESS = 12.0
"""Force with which the task presses [N]."""

TASK = f"""
format: 1
name: sway-and-press
robot: baxter
arms:
  right:
    posture: {{s0: 0.4666, s1: -0.7179, e0: 0.3787, e1: 1.5412, w0: -0.3896, w1: 0.8229, w2: 0.2095}}
    joint_bias: {{stiffness: {{s0: 3, s1: 3, e0: 3, e1: 3, w0: 3, w1: 3, w2: 3}}, damping_ratio: 0.7}}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {{x: 300, y: 300, z: 300, rx: 8, ry: 8, rz: 8}}
        damping_ratio: 0.7
safety: {{tank: {{initial: 12, max: 24, floor: 0.3}}}}
environment: [{{surface: plane, height: -0.03, stiffness: 10000, damping: 100, friction: 0.2}}]
phases:
  - name: sway
    equilibrium: {{right.hand: {{y: {{sine: {{amplitude: 0.08, frequency: 0.4}}}}}}}}
    duration: 5
  - name: press
    stiffness: {{right.hand: {{x: 300, y: 300, z: 0, rx: 8, ry: 8, rz: 8}}}}
    axes: {{right.hand: {{z: {{force: -{PRESS:g}, speed_limit: 0.1}}}}}}
    duration: 3
  - name: slide
    equilibrium: {{right.hand: {{y: {{sine: {{amplitude: 0.05, frequency: 0.3}}}}}}}}
    duration: 6
"""

Random = np.random.Generator
Numbers = dict[str, dict[str, tuple[float, str]]]


def on_joints(random: Random, symbols: Callable[[Random, float], dict[str, tuple[float, str]]]) -> Numbers:
    """Draws numbers for two joints of the right arm; those of the wrist are a third as large."""
    joints = random.choice(["s0", "s1", "e0", "e1", "w1"], size=2, replace=False)
    return {f"right_{j}": symbols(random, 0.35 if j.startswith("w") else 1.0) for j in sorted(joints)}


def signed(random: Random, low: float, high: float) -> float:
    """Draws a number of either sign."""
    return float(random.choice([-1.0, 1.0]) * random.uniform(low, high))


def _asymmetric(random: Random, size: float) -> dict[str, tuple[float, str]]:
    fc = size * random.uniform(0.8, 1.6)
    return {"fc": (fc, "N.m"), "da": (fc * signed(random, 0.3, 0.6), "N.m")}


def _stribeck(random: Random, size: float) -> dict[str, tuple[float, str]]:
    fc = size * random.uniform(0.6, 1.2)
    return {
        "fc": (fc, "N.m"),
        "fs": (fc * random.uniform(1.5, 2.0), "N.m"),
        "vs": (random.uniform(0.06, 0.15), "rad/s"),
    }


DRAWN: dict[str, tuple[str, Callable[[Random], Numbers]]] = {
    "coulomb_friction": (
        "actuator",
        lambda r: on_joints(r, lambda r, size: {"fc": (size * r.uniform(0.7, 1.8), "N.m")}),
    ),
    "viscous_friction": (
        "actuator",
        lambda r: on_joints(r, lambda r, size: {"fv": (size * r.uniform(1.5, 4.0), "N.m.s/rad")}),
    ),
    "stribeck_friction": ("actuator", lambda r: on_joints(r, _stribeck)),
    "quadratic_drag": (
        "actuator",
        lambda r: on_joints(r, lambda r, size: {"c": (size * r.uniform(2.0, 4.0), "N.m.s^2/rad^2")}),
    ),
    "asymmetric_friction": ("actuator", lambda r: on_joints(r, _asymmetric)),
    "load_dependent_friction": (
        "actuator",
        lambda r: {f"right_{j}": {"kl": (r.uniform(0.05, 0.12), "1")} for j in ("s1", "e1")},
    ),
    "torque_offset": (
        "link",
        lambda r: on_joints(r, lambda r, size: {"c": (size * signed(r, 1.0, 3.0), "N.m")}),
    ),
    "torque_gain": (
        "actuator",
        lambda r: {f"right_{j}": {"s": (1.0 + signed(r, 0.06, 0.15), "1")} for j in ("s1", "e1")},
    ),
    "payload": (
        "link",
        lambda r: {
            "right_hand": {
                "m": (r.uniform(0.3, 0.8), "kg"),
                "cx": (r.uniform(-0.03, 0.03), "m"),
                "cy": (r.uniform(-0.03, 0.03), "m"),
                "cz": (r.uniform(0.0, 0.1), "m"),
            }
        },
    ),
    "link_inertia": (
        "link",
        lambda r: {"right_lower_forearm": {"dm": (r.uniform(0.3, 0.7), "kg"), "dhz": (0.03, "kg.m")}},
    ),
    "base_tilt": (
        "link",
        lambda r: {"base": {"rx": (signed(r, 0.02, 0.06), "rad"), "ry": (signed(r, 0.02, 0.06), "rad")}},
    ),
    "bench_spring": (
        "contact",
        lambda r: on_joints(
            r,
            lambda r, size: {
                "k": (size * r.uniform(4.0, 9.0), "N.m/rad"),
                "q0": (r.uniform(-0.3, 0.3), "rad"),
            },
        ),
    ),
}
"""Effect -> port, and its numbers."""

OUTSIDE = {"parallel_spring": ("bench_spring", "contact")}
"""A spring that this robot does not carry is diagnosed as one that it may carry; whoever compensates it says which."""


def write_truth(path: Path, effect: str, seed: int) -> None:
    """Writes the withheld effect of a case as a patch."""
    port, draw = DRAWN[effect]
    numbers = draw(np.random.default_rng([seed, zlib.crc32(effect.encode())]))
    joints = [key for key in numbers if key not in ("base", "right_hand", "right_lower_forearm")]
    parameters = {
        key: {symbol: {"value": float(value), "unit": unit} for symbol, (value, unit) in symbols.items()}
        for key, symbols in numbers.items()
    }
    found = {"effect": effect, "joints": joints, "port": port, "parameters": parameters}
    write_patch(path, [found])


def write_patch(path: Path, effects: Sequence[dict[str, Any]]) -> None:
    """Writes effects as a patch of this benchmark's own."""
    head = {
        "format": 1,
        "robot": "baxter",
        "provenance": {"origin": "hand", "date": "2026-11-23", "note": "Of benchmarks/compensation.py."},
    }
    path.write_text(yaml.safe_dump({**head, "effects": list(effects)}, sort_keys=False))


def record(folder: Path, truth: Path, seed: int) -> list[Path]:
    """Records the three motions with the effect in the plant."""
    found = []
    for number, motion in enumerate(RECORDED):
        task = str(MOTIONS / f"{motion}.yaml")
        # The recording must not carry the answer: effects reach the plant alone, as on a real robot.
        real = assemble(task, effects=truth, rate=RATE, scale=1.0, arm=None)
        blind = assemble(task, effects=None, rate=RATE, scale=1.0, arm=None)
        robot = make_backend(real, backend="sim", log=None, seed=10 * seed + number)
        options = RunOptions(folder / f"log-{number}", seed, None, live=False, read_only=False, backend="sim")
        carry_out(blind, robot, options, lambda _time, _phase: None)
        found.append(options.out)
    return found


def diagnose(logs: Sequence[Path], folder: Path) -> dict[str, Any]:
    """Asks ``impedance diagnose``, the last recording held out; its patch is ``diagnosed.yaml``, if there is one."""
    command = [sys.executable, "-m", "impedance_modules", "diagnose", *map(str, logs[:-1])]
    command += ["--holdout", str(logs[-1]), "--robot", "baxter", "--json", str(folder / "answer.json")]
    command += ["--patch", str(folder / "diagnosed.yaml")]
    subprocess.run(command, capture_output=True, text=True, check=False)
    answer = json.loads((folder / "answer.json").read_text())
    return {"verdict": answer["verdict"], "causes": [cause["effect"] for cause in answer["causes"]]}


def compensable(folder: Path) -> tuple[Path | None, list[str]]:
    """Keeps of the diagnosed patch what a controller can compensate; says what it left out."""
    path = folder / "diagnosed.yaml"
    if not path.is_file():
        return None, []
    kept, left = [], []
    for found in yaml.safe_load(path.read_text())["effects"]:
        name, port = OUTSIDE.get(found["effect"], (found["effect"], found["port"]))
        if name == "bench_spring":
            for symbols in found["parameters"].values():
                preload = symbols.pop("preload", None)
                if preload is not None:
                    symbols["q0"] = {"value": preload["value"] / symbols["k"]["value"], "unit": "rad"}
        if port in CATALOGUE[name].compensated_at:
            kept.append({**found, "effect": name, "port": port})
        else:
            left.append(name)
    if not kept:
        return None, left
    write_patch(folder / "compensated.yaml", kept)
    return folder / "compensated.yaml", left


class Seen:
    """One run of the task on the plant, and what it came to."""

    def __init__(self, assembly: Assembly, seed: int) -> None:
        supervisor, backend = Supervisor(assembly), sim_backend(assembly, seed)
        first = backend.start()
        supervisor.start(first)
        self._supervisor, self._backend = supervisor, backend
        self.q: list[np.ndarray] = []
        self.hand: list[np.ndarray] = []
        self._off: list[np.ndarray] = []
        self._force: list[float] = []
        self._phase: list[str] = []
        self._tank: list[float] = []
        timing = {"duration": None, "paced": False, "read_only": False}
        run_loop(supervisor, backend, first.state, self._watch, Interrupt(), **timing)
        self.ending, self.reason = supervisor.ending, supervisor.reason
        self.lowest_tank = min(self._tank)

    def _watch(self, *_cycle: object) -> None:
        controller, plant = self._supervisor.controller, self._backend.plant
        self._tank.append(controller.tank.level)
        self.q.append(plant.position.copy())
        target = controller.cycle.modules.springs.target_translation[0]
        self.hand.append(plant.pose("right_hand").translation.copy())
        self._off.append(self.hand[-1] - target)
        self._force.append(float(plant.contact_wrench("right_hand")[2]))
        self._phase.append(self._supervisor.sequence.phase.name)

    def numbers(self, absent: Seen | None = None) -> dict[str, float]:
        """Root mean squares, the hand's while it sways, the force's while it slides.

        Distance from the equilibrium [mm], and from where another run has the hand [mm]; from that run's force [N].
        """
        other = self if absent is None else absent
        phase, off = np.array(self._phase), np.array(self._off)
        sway, slide = phase == "sway", phase == "slide"
        n = min(len(self.hand), len(other.hand))
        away = (np.array(self.hand)[:n] - np.array(other.hand)[:n])[sway[:n]]
        push = (np.array(self._force)[:n] - np.array(other._force)[:n])[slide[:n]]
        return {
            "tracking": 1e3 * float(np.sqrt(np.mean(np.sum(off[sway] ** 2, axis=1)))),
            "hand": 1e3 * float(np.sqrt(np.mean(np.sum(away**2, axis=1)))),
            "force": float(np.sqrt(np.mean(push**2))) if push.size else float("nan"),
            "lowest_tank": self.lowest_tank,
            "done": float(self.ending is not None and self.ending.value == "done"),
        }


def apart(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> float:
    """Root mean square distance of two runs' joints, cycle by cycle [mrad]."""
    n = min(len(first), len(second))
    return 1e3 * float(np.sqrt(np.mean(np.sum((np.array(first[:n]) - np.array(second[:n])) ** 2, axis=1))))


def run_case(effect: str, seed: int, folder: Path, *, exact: bool) -> dict[str, Any]:
    """Carries one case out; ``exact`` compensates the effect's own numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    truth, task = folder / "truth.yaml", folder / "task.yaml"
    write_truth(truth, effect, seed)
    task.write_text(TASK)

    def seen(effects: Path | None, compensate: Path | None = None) -> Seen:
        assembly = assemble(str(task), effects=effects, compensate=compensate, rate=RATE, scale=1.0, arm=None)
        return Seen(assembly, seed)

    case: dict[str, Any] = {"effect": effect, "seed": seed}
    if exact:
        patch = truth
    else:
        case |= diagnose(record(folder, truth, seed), folder)
        patch, case["left_out"] = compensable(folder)
    absent, before = seen(None), seen(truth)
    case |= {
        "absent": absent.numbers(),
        "before": before.numbers(absent),
        "joints": apart(before.q, absent.q),
    }
    if patch is not None:
        after = seen(truth, patch)
        case["after"] = after.numbers(absent)
    if patch is not None and not exact:
        case["reverse"] = reverse(patch, seen, before)
    return case


def reverse(patch: Path, seen: Callable[[Path | None], Seen], before: Seen) -> float | None:
    """Distance of the run with the effect from a run with the diagnosed patch [mrad]; None where it does not run."""
    try:
        return apart(before.q, seen(patch).q)
    except BadInput:
        return None


def table(folder: Path) -> str:
    """Lays all finished cases out: medians over the seeds, with the range in brackets."""
    cases: dict[str, list[dict[str, Any]]] = {}
    for path in sorted(folder.glob("*/case.json")):
        case = json.loads(path.read_text())
        cases.setdefault(case["effect"], []).append(case)
    heads = ["effect", "cases, compensated", "tracking mm, absent", "with", "compensated"]
    heads += ["hand from absent mm, with", "compensated", "force from absent N, with", "compensated"]
    heads += ["joints from recording mrad, nominal plant", "patched plant"]
    lines = [f"| {' | '.join(heads)} |", "|" + len(heads) * "---|"]
    for effect in (name for name in DRAWN if name in cases):
        every, done = cases[effect], [case for case in cases[effect] if "after" in case]
        cells = [f"`{effect}`", f"{len(every)}, {len(done)}"]
        cells += [spread([case[run]["tracking"] for case in done]) for run in ("absent", "before", "after")]
        for number in ("hand", "force"):
            cells += [spread([case[run][number] for case in done]) for run in ("before", "after")]
        cells.append(spread([case["joints"] for case in done]))
        cells.append(spread([case["reverse"] for case in done if case.get("reverse") is not None]))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def spread(values: Sequence[float]) -> str:
    """Writes a median and the range around it."""
    if not values:
        return "-"
    middle, low, high = np.median(values), min(values), max(values)
    return f"{middle:.2f}" if low == high else f"{middle:.2f} ({low:.2f} to {high:.2f})"


def main() -> None:
    """Runs the cases that are not there yet, or prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help=", ".join(DRAWN))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/compensation"))
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--exact", action="store_true")
    options = parser.parse_args()
    if options.table:
        print(table(options.out))
        return
    unknown = [name for name in options.effects if name not in DRAWN]
    if unknown:
        parser.error(f"no effect {', '.join(unknown)} (valid: {', '.join(DRAWN)})")
    for seed in range(1, options.seeds + 1):
        for effect in options.effects or DRAWN:
            folder = options.out / f"{effect}-{seed}"
            if not (folder / "case.json").is_file():
                case = run_case(effect, seed, folder, exact=options.exact)
                (folder / "case.json").write_text(json.dumps(case, indent=1) + "\n")
                print(json.dumps(case), flush=True)


if __name__ == "__main__":
    main()
