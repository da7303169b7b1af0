# SPDX-License-Identifier: BSD-3-Clause
"""Two FR3 carry a box: on the built-in plant, on MuJoCo and on simulated arms over the maker's protocol.

    python -m benchmarks.backends.fr3_box [--rate 1000] [--runs 3] [--slower 1] [--priority 50]

The task is tests/data/fr3-box.yaml. The simulated arms (franky-sim) have dry friction, so plant and MuJoCo have it too:
robots/fr3-pair/patches/simulated-dry-friction.yaml. Table and box are added to that simulator's scene, and a person who
holds the box for 0.8 s of the first phase (tests/support/franka_scene.py). How far a hand is from where the plant's was
is counted phase by phase, from the start of each: contact is not felt at the same moment everywhere.

A run on the simulated arms that the load of the machine stopped is repeated, which is said. ``--slower 5`` lets the
clock of the simulated arms go five times slower, for busy machines; ``--priority 50`` gives the run on these arms, not
their simulator, that real-time priority (SCHED_FIFO, by chrt; root, or a user who may).
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from tests.support.baxter_process import BUSY
from tests.support.franka_simulator import simulated_arms

ROOT = Path(__file__).parents[2]
TASK = ROOT / "tests" / "data" / "fr3-box.yaml"
PATCH = ROOT / "robots" / "fr3-pair" / "patches" / "simulated-dry-friction.yaml"
LIMBS = ("right", "left")

ATTEMPTS = 4
"""At a run that the machine's load stops."""

TOO_SLOW = re.compile(BUSY.pattern + "|states per second|of the commands in time|torque mode does not")
"""What a run is refused or stopped with on a machine that is too slow."""

TOUCHING = "rest"
"""The phase in which the box stands on the table."""

LIMITS = {True: 0.010, False: 0.005}
"""How far a hand may be from the plant's, RMS [m]: with contact, in free motion."""


def watch(slower: float) -> str:
    """What is borne from simulated arms on a computer that does other things, too; waits grow with their cycle."""
    waits = f"patience: {min(0.2 * slower, 1.0):g}, silent: {min(0.5 * slower, 1.0):g}"
    return f"{{least_rate: 20, least_success: 0, {waits}, answer: {min(5e-4 * slower, 9e-4):g}}}"


class NotCarriedOutError(Exception):
    """A run did not reach its end; says why."""


@dataclass(frozen=True)
class BoxRun:
    """One run that reached its end.

    Attributes:
        episode: Its recording.
        summary: Its summary.
    """

    episode: Episode
    summary: dict

    @property
    def phases(self) -> list[str]:
        """Names, in the order in which they ended."""
        return [phase["name"] for phase in self.summary["phases"]]

    def path(self, hand: str, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Times since a phase began (N,) [s] and places of a hand (N, 3) [m]."""
        rows = np.asarray(self.episode.phase) == phase
        time = self.episode.time[rows]
        return time - time[0], self.episode.pose[hand][rows, :3]

    def account(self) -> str:
        """What ended the run and its phases, the tank, and how many torques left in time where arms were commanded."""
        ended = ", ".join(f"{phase['name']} ({phase['ended_by']})" for phase in self.summary["phases"])
        words = f"{self.summary['ending']}: {ended}; tank at least {self.summary['tank']['lowest']:.2f} J"
        for limb in LIMBS:
            if (fresh := self.episode.extra.get(f"fresh_torque.{limb}")) is not None:
                lost = self.episode.extra[f"states_lost.{limb}"][-1]
                words += f"; {limb}: {np.mean(fresh):.1%} of the torques in time, {lost:.0f} states lost"
        return words


def distances(reference: BoxRun, other: BoxRun, hand: str, phase: str) -> np.ndarray:
    """How far a hand is from where it is in another run, at each moment of a phase while both last (N,) [m]."""
    time, place = reference.path(hand, phase)
    times, places = other.path(hand, phase)
    both = time <= times[-1]
    there = np.column_stack([np.interp(time[both], times, places[:, k]) for k in range(3)])
    return np.linalg.norm(there - place[both], axis=1)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def is_like(reference: BoxRun, run: BoxRun) -> bool:
    """Whether phases come in the same order and each hand stays within ``LIMITS`` of the reference in each phase."""
    return run.phases == reference.phases and all(
        rms(distances(reference, run, hand, phase)) <= LIMITS[phase == TOUCHING]
        for hand in reference.episode.pose
        for phase in reference.phases
    )


@dataclass(frozen=True)
class Pace:
    """How the run on simulated arms shares the machine with their simulator.

    Attributes:
        slower: By which factor the arms' clock goes slower than ours.
        priority: Real-time priority of the run; None for none.
    """

    slower: float = 1.0
    priority: int | None = None

    @property
    def command(self) -> list[str]:
        """The program that a run is started with."""
        first = [] if self.priority is None else ["chrt", "--fifo", str(self.priority)]
        program = (
            ["impedance_modules"] if self.slower == 1.0 else ["tests.support.slow_clock", f"{self.slower:g}"]
        )
        return [*first, sys.executable, "-m", *program]


def run_once(out: Path, *words: object, pace: Pace = Pace()) -> BoxRun:
    """Carries the task out once, by the command line.

    Args:
        out: For its files.
        words: Of the command, beyond the task.
        pace: How it shares the machine.

    Raises:
        NotCarriedOutError: It was refused or stopped.
    """
    command = [*pace.command, "run", str(TASK), *map(str, words), "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    written = out / "summary.json"
    summary = json.loads(written.read_text()) if written.exists() else {}
    if done.returncode != 0:
        reason = f"stopped: {summary['reason']}" if summary else f"refused: {done.stderr.strip()}"
        raise NotCarriedOutError(reason)
    return BoxRun(read_episode(out), summary)


def run_simulated(out: Path, backend: str, rate: float, seed: int) -> BoxRun:
    """On the built-in plant or MuJoCo, with the friction of the simulated arms."""
    return run_once(out, "--backend", backend, "--effects", PATCH, "--rate", rate, "--seed", seed)


def run_on_arms(out: Path, rate: float, pace: Pace) -> BoxRun:
    """On simulated FR3 over the maker's protocol; again, with new arms, where the machine's load stopped a run."""
    for attempt in range(1, ATTEMPTS + 1):
        folder = out / str(attempt)
        folder.mkdir(parents=True)
        with simulated_arms(len(LIMBS), f"--task={TASK}", f"--slower={pace.slower:g}") as arms:
            connection = folder / "connection.yaml"
            connection.write_text(arms.connection(LIMBS, watch(pace.slower)))
            words = ("--backend", "franka", "--connection", connection, "--rate", rate)
            try:
                return run_once(folder / "run", *words, pace=pace)
            except NotCarriedOutError as failure:
                if attempt == ATTEMPTS or not TOO_SLOW.search(str(failure)):
                    raise
                print(f"the machine's load ended attempt {attempt}, another follows: {failure}", flush=True)
    raise NotCarriedOutError("no attempt was made")


def spread(values: list[float]) -> str:
    """The least and the most of some lengths [m], in mm."""
    least, most = f"{1e3 * min(values):.2f}", f"{1e3 * max(values):.2f}"
    return least if least == most else f"{least} to {most}"


def table(name: str, reference: BoxRun, runs: list[BoxRun]) -> Iterator[str]:
    """Rows: how far each hand is from the plant's in each phase, least to most over the runs."""
    for phase in reference.phases:
        cells = []
        for hand in reference.episode.pose:
            away = [distances(reference, run, hand, phase) for run in runs]
            cells += [spread([rms(values) for values in away]), spread([values.max() for values in away])]
        yield f"| {name} | {phase} | {' | '.join(cells)} | {1e3 * LIMITS[phase == TOUCHING]:g} |"


def compare(folder: Path, rate: float, runs: int, pace: Pace) -> bool:
    """Carries everything out and prints; returns whether all runs reached their end within the limits."""
    reference = run_simulated(folder / "plant", "sim", rate, 0)
    print(f"built-in plant, {reference.account()}", flush=True)
    ways: dict[str, Callable[[int], BoxRun]] = {
        "built-in plant": lambda k: run_simulated(folder / f"plant-{k}", "sim", rate, 1 + k),
        "MuJoCo": lambda k: run_simulated(folder / f"mujoco-{k}", "mujoco", rate, k),
        "simulated FR3": lambda k: run_on_arms(folder / f"arms-{k}", rate, pace),
    }
    rows, fine = list[str](), True
    for name, way in ways.items():
        found = []
        for k in range(runs):
            try:
                found.append(way(k))
            except NotCarriedOutError as failure:
                print(f"{name}, run {k + 1}: {failure}", flush=True)
                fine = False
                continue
            like = is_like(reference, found[-1])
            fine = fine and like
            verdict = "within the limits" if like else "NOT within the limits"
            print(f"{name}, run {k + 1}, {found[-1].account()}; {verdict}", flush=True)
        if found:
            rows += table(f"{name}, {len(found)} of {runs} runs", reference, found)
    print("\nfrom the plant's hands, mm (other seeds of the plant: what noise alone makes)")
    print("| backend | phase | right, RMS | right, at most | left, RMS | left, at most | allowed RMS |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(rows))
    return fine


def main() -> int:
    """Prints the comparison; 1 where a run did not reach its end or is too far from the plant's."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rate", type=float, default=1000.0, help="of the control loop [Hz]")
    parser.add_argument("--runs", type=int, default=3, help="on each backend")
    parser.add_argument("--slower", type=float, default=1.0, help="the simulated arms' clock, by this factor")
    parser.add_argument("--priority", type=int, help="real-time priority of the run on the simulated arms")
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        pace = Pace(asked.slower, asked.priority)
        return 0 if compare(Path(folder), asked.rate, asked.runs, pace) else 1


if __name__ == "__main__":
    sys.exit(main())
