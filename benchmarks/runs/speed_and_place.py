# SPDX-License-Identifier: BSD-3-Clause
"""Whether joints keep their speed limits and ranges, and links their distance, on random tasks that are accepted.

Usage: python -m benchmarks.runs.speed_and_place [--tasks 1000] [--seed 1] [--out FILE] [--robot NAME_OR_FOLDER ...]

Tasks of ``random_tasks`` are drawn until ``--tasks`` of them pass what ``impedance check`` refuses, and each is run on
the built-in plant with sensor noise, no patch, no push; one that ``check`` refuses because of its trial on the plant is
run all the same, with other noise than the trial's, and counted apart. Speeds are the plant's own, of links and of
motors, at every loop of the robot (1 ms or shorter). One line of JSON per task goes to ``--out``; a benchmark that is
started again goes on after the last line. The table that it prints is made of that file alone (``--table`` prints it
and runs nothing).
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.random_tasks import RandomTask, Shapes, draw_task
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, no_collections, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.feasibility import TaskPrediction, refuse_infeasible
from impedance_modules.prediction.forecast import forecast_task
from impedance_modules.prediction.joint_limits import limits_met
from impedance_modules.robot.model import RobotModel
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.runs.trial_run import try_on_plant
from impedance_modules.spec.locate import find_robot
from impedance_modules.spec.robot_reader import read_robot

Array = NDArray[np.float64]

ALLOWED = 1.02
"""Of a joint's declared speed."""

DISTANCE_LOOKS = 0.005
"""Time between two looks at the distances of all pairs [s]."""

ROBOTS = ("baxter", "baxter", "baxter", "baxter", "single_wheel")
"""Drawn in turn; most tasks are for two arms of seven elastic joints."""


@dataclass
class Observed:
    """What a run really did, beyond what its robot reports; ``shapes`` and the rest of the plant's truth are read.

    Attributes:
        plant, shapes: Looked at.
        supervisor: Of the run: the time of its stop is noted.
        ratio: (n,) largest speed over limit, of motor or link.
        outside: (n,) farthest beyond a joint's range [rad].
        closest: Smallest distance of a pair [m].
        exceeded: Time of the first excess of speed [s]; None where there is none.
        stopped: Time of the first cycle of a stop [s]; None where the task was done.
        at_stop: Largest speed over limit before the stop.
    """

    plant: Plant
    shapes: Shapes
    supervisor: Supervisor
    limit: Array
    low: Array
    high: Array
    ratio: Array = field(init=False)
    outside: Array = field(init=False)
    closest: float = math.inf
    exceeded: float | None = None
    stopped: float | None = None
    at_stop: float = 0.0
    trace: list[tuple[float, Array, Array]] | None = None
    _loops: int = 0
    _every: int = 1

    def __post_init__(self) -> None:
        self.ratio, self.outside = np.zeros(self.limit.size), np.zeros(self.limit.size)
        self._every = max(1, round(DISTANCE_LOOKS / self.plant.division.loop))

    def look(self) -> None:
        """Looks at the plant once more, after one of the robot's loops."""
        state = self.plant.state.start
        speeds = np.maximum(np.abs(state.velocity), np.abs(state.motor_velocity)) / self.limit
        np.maximum(self.ratio, speeds, out=self.ratio)
        beyond = np.maximum(self.low - state.position, state.position - self.high)
        np.maximum(self.outside, beyond, out=self.outside)
        now = self._loops * self.plant.division.loop
        if self.exceeded is None and not np.max(speeds) <= ALLOWED:
            self.exceeded = now
        if self.supervisor.reason and self.stopped is None:
            self.stopped, self.at_stop = now, float(np.max(self.ratio))
        if self._loops % self._every == 0:
            self.closest = min(self.closest, self.shapes.closest(state.position))
        self._loops += 1


def carry_out(assembly: Assembly, shapes: Shapes, seed: int) -> tuple[Supervisor, Observed]:
    """Runs an assembled task on the built-in plant, noise on, and watches the plant."""
    backend, supervisor = sim_backend(assembly, seed), Supervisor(assembly)
    limits = assembly.limits
    first = backend.start()
    supervisor.start(first)
    seen = Observed(
        backend.plant, shapes, supervisor, limits.velocity_max, limits.position_min, limits.position_max
    )
    loop = backend.plant._robot_loop

    def watched_loop() -> None:
        loop()
        seen.look()

    backend.plant._robot_loop = watched_loop
    with no_collections():
        run_loop(
            supervisor,
            backend,
            first.state,
            lambda *_: None,
            Interrupt(),
            duration=None,
            paced=False,
            read_only=False,
        )
    return supervisor, seen


def assembled(drawn: RandomTask, folder: Path) -> Assembly:
    """Reads a drawn task as ``impedance run`` does."""
    path = folder / "task.yaml"
    path.write_text(drawn.text)
    return assemble(str(path), effects=None, rate=drawn.rate, scale=drawn.scale, arm=None)


class Robots:
    """Robots by name or folder, each read once, with its shapes."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self._found: dict[str, tuple[RobotModel, Shapes]] = {}

    def draw(self, seed: int, number: int) -> tuple[RandomTask | None, Shapes]:
        """Draws the task of a number."""
        name = self.names[number % len(self.names)]
        if name not in self._found:
            model = RobotModel(read_robot(find_robot(name)))
            self._found[name] = (model, Shapes(model))
        model, shapes = self._found[name]
        shipped = name if "/" not in name else str(Path(name).resolve())
        return draw_task(model, shapes, shipped, seed, number), shapes


def judged(robots: Robots, seed: int, number: int, folder: Path) -> dict[str, Any]:
    """One line of the file: a task refused, with why, or what its run did."""
    drawn, shapes = robots.draw(seed, number)
    line: dict[str, Any] = {"number": number}
    if drawn is None:
        return line | {"refused": "no posture free of collisions"}
    try:
        assembly = assembled(drawn, folder)
        prediction = refuse_infeasible(assembly)
        forecast = forecast_task(assembly, prediction)
    except np.linalg.LinAlgError as error:
        # A prediction that diverges so far that its numbers end is no accepted task.
        return line | {"refused": f"the prediction fails: {error}"}
    except BadInput as error:
        return line | {"refused": str(error).splitlines()[0].replace(str(folder), "")}
    line["growth"] = round(max(loop.growth for phase in forecast.phases for loop in phase.loops), 6)
    refused = refused_on_plant(assembly, prediction)
    supervisor, seen = carry_out(assembly, shapes, number)
    ran = run_line(assembly, supervisor, seen)
    return line | (ran if refused is None else {"refused": refused, "would": ran})


def refused_on_plant(assembly: Assembly, prediction: TaskPrediction) -> str | None:
    """Why the trial of ``impedance check``, with its own noise, refuses a task; None where it does not."""
    met = limits_met(assembly.model, prediction)
    if not met:
        return None
    try:
        try_on_plant(assembly, met, 0, lambda *_: None)
    except BadInput as error:
        return f"on the plant: {str(error).split(': ', 2)[-1]}"
    return None


def run_line(assembly: Assembly, supervisor: Supervisor, seen: Observed) -> dict[str, Any]:
    """What a run did, in numbers for JSON."""
    worst = int(np.argmax(seen.ratio))
    stop = None
    if supervisor.reason and seen.exceeded is not None:
        since = (seen.plant.time if seen.stopped is None else seen.stopped) - seen.exceeded
        stop = math.ceil(since * assembly.rate - 1e-6)
    return {
        "robot": assembly.robot.name,
        "rate": assembly.rate,
        "scale": assembly.scale,
        "ended": "" if supervisor.ending is None else supervisor.ending.value,
        "reason": supervisor.reason,
        "speed": round(float(seen.ratio[worst]), 4),
        "speed_before_stop": round(float(seen.at_stop if seen.stopped is not None else seen.ratio[worst]), 4),
        "joint": assembly.model.joint_names[worst],
        "speeds": {
            n: round(float(r), 4) for n, r in zip(assembly.model.joint_names, seen.ratio, strict=True)
        },
        "outside": round(float(np.max(seen.outside)), 5),
        "closest_above_margin": None
        if math.isinf(seen.closest)
        else round(seen.closest - assembly.limits.margin, 5),
        "cycles_to_stop": stop,
        "exceeded_at": seen.exceeded,
        "stopped_at": seen.stopped,
    }


def lines_of(path: Path) -> list[dict[str, Any]]:
    """Lines written so far; one that was cut off by a kill is left out."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]


def table(lines: list[dict[str, Any]]) -> Iterator[str]:
    """The figures of a file."""
    ran = [line for line in lines if "refused" not in line]
    fast = [line for line in ran if not line["speed"] <= ALLOWED]
    yield f"tasks drawn {len(lines)}, refused {len(lines) - len(ran)}, accepted and run {len(ran)}"
    tried = [line["would"] for line in lines if "would" in line]
    kept = sum(would["speed"] <= ALLOWED and would["ended"] == "done" for would in tried)
    done = sum(line["speed"] <= ALLOWED and line["ended"] == "done" for line in ran)
    yield (
        f"refused by the trial on the plant: {len(tried)}; with other noise {kept} of them keep their speeds and are"
        f" done, as {done} of those accepted"
    )
    if not ran:
        return
    unstopped = [line for line in ran if not line["speed_before_stop"] <= ALLOWED]
    yield f"speed above {ALLOWED} x limit: {len(fast)} runs, {len(unstopped)} of them before a stop"
    worst: dict[str, float] = {}
    for line in ran:
        for joint, ratio in line["speeds"].items():
            worst[joint] = max(worst.get(joint, 0.0), ratio)
    yield "worst speed / limit: " + ", ".join(f"{joint} {ratio:.3f}" for joint, ratio in worst.items())
    yield f"worst position beyond a range: {max(line['outside'] for line in ran):.4f} rad"
    rooms = [line["closest_above_margin"] for line in ran if line["closest_above_margin"] is not None]
    if rooms:
        below = [room for room in rooms if room < 0.0]
        yield f"distance below the margin: {len(below)} runs, worst {-min([0.0, *rooms]) * 1e3:.1f} mm"
    causes = Counter(_cause(line["reason"]) for line in ran if line["reason"])
    yield f"stops: {sum(causes.values())} " + ", ".join(f"{name} {n}" for name, n in causes.most_common())
    waits = [line["cycles_to_stop"] for line in fast if line["cycles_to_stop"] is not None]
    yield f"cycles from the excess to the stop: worst {max(waits, default=0)}; never stopped {len(fast) - len(waits)}"
    for line in sorted(fast, key=lambda each: -each["speed"])[:25]:
        yield (
            f"  {line['number']:6d} {line['robot']} {line['rate']:6.1f} Hz {line['joint']} {line['speed']:.3f}"
            f" (before stop {line['speed_before_stop']:.3f}) {line['reason']}"
        )


def _cause(reason: str) -> str:
    """The event's name in a stop's reason."""
    return reason.split(":", 1)[1].split("(", maxsplit=1)[0].strip()


def main() -> None:
    """Runs what is missing, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=1000, help="accepted tasks to run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/speed-and-place.jsonl"))
    parser.add_argument("--robot", action="append", help="name or folder; again for more, drawn in turn")
    parser.add_argument("--table", action="store_true", help="print the table of --out, run nothing")
    options = parser.parse_args()
    lines = lines_of(options.out)
    if not options.table:
        robots = Robots(tuple(options.robot or ROBOTS))
        options.out.parent.mkdir(parents=True, exist_ok=True)
        ran = sum("refused" not in line for line in lines)
        with tempfile.TemporaryDirectory() as folder, options.out.open("a") as file:
            while ran < options.tasks:
                line = judged(robots, options.seed, len(lines), Path(folder))
                lines.append(line)
                ran += "refused" not in line
                print(json.dumps(line), file=file, flush=True)
    for text in table(lines):
        print(text)


if __name__ == "__main__":
    main()
