# SPDX-License-Identifier: BSD-3-Clause
"""Whether the controller ever does more work than its tank paid for, whatever world, wire and sensors do.

Usage: python -m benchmarks.runs.adversarial_runs [--runs 1000] [--seed 1] [--out FILE] [--unpaid]

Tasks of ``random_tasks`` that ``impedance check`` accepts run on the built-in plant, noise on, with a tank that holds
0.1 to 1 J above its floor, less than most of them need, each in one of these worlds, in turn:

- alone: nothing else happens;
- pumping: every link is pushed to and fro, and pulled along wherever the controller pushes, so that it does work;
- late, lost: a tenth of all states come too late, are overtaken by newer ones, or never come; pumped as well;
- repeated, swapped: a tenth are the state before once more, or change places with the next; pumped as well;
- one world per wrong sensor (``SENSORS``), which the controller knows nothing of, at its bounds; pumped as well.

The plant integrates the work of the torques that acted over what the motors really turned. Compared with it are:

- the claim: work <= T_0 + U_0 - r U, with U at the measured state (docs/passivity.md);
- the ledger: | work - work as booked | <= the stated bound of sensing.

``--unpaid`` takes away what the tank has to say, the power row and the scaling: then the claim must break. Exit 1 if
the claim or the ledger is broken in a world whose sensors are as the robot file says. A benchmark that is started again
goes on after the last line of ``--out``.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.runs.speed_and_place import ROBOTS, Robots, assembled, lines_of
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.loop import Interrupt, no_collections, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.runs.task_plant import sim_backend
from tests.support.adversity import Books, Pushes, UnreliableRobot
from tests.support.effect_recordings import AppliedEffect, applied, patch_of

ROUNDING = 1e-6
"""Of the plant's quadrature of its own work [J]."""

SENSORS: Mapping[str, tuple[str, str, Sequence[tuple[str, float, float]]]] = {
    "encoder_offset": ("sensor", "joint", (("dq0", -0.2, 0.2),)),
    "torque_offset": ("sensor", "joint", (("c", -10.0, 10.0),)),
    "torque_gain": ("sensor", "joint", (("s", 0.3, 1.8),)),
    "crosstalk": ("sensor", "pair", (("c", -1.0, 1.0),)),
    "velocity_filter_lag": ("sensor", "joint", (("T", 0.0, 0.1),)),
    "clock_drift": ("timing", "log", (("ppm", -1e4, 1e4),)),
}
"""Effect -> its port, whether of joints, pairs or the log, and its parameters' bounds: the catalogue's where it has any
that a run can live with, else ten times what robots were seen to have."""


@dataclass(frozen=True)
class World:
    """What a run has against it.

    Attributes:
        name: Of the row.
        pumping: Links are pushed and pulled.
        states: Share of states that each thing happens to.
        sensor: Effect that the plant's sensors have and the model lacks.
    """

    name: str
    pumping: bool = True
    states: Mapping[str, float] = field(default_factory=dict)
    sensor: str | None = None

    @property
    def sound(self) -> bool:
        """Sensors are as the robot file says."""
        return self.sensor is None


WORLDS = (
    World("alone", pumping=False),
    World("pumping"),
    World("late, overtaken, lost", states={"late": 0.04, "overtaken": 0.03, "lost": 0.03}),
    World("repeated, swapped", states={"repeated": 0.05, "swapped": 0.05}),
    *(World(f"sensor: {name}", sensor=name) for name in SENSORS),
)


def wrong_sensor(random: np.random.Generator, assembly: Assembly, name: str) -> Assembly:
    """Gives every joint's sensor of the plant, not of the model, an effect at one end of its bounds."""
    port, where, bounds = SENSORS[name]
    joints = assembly.model.joint_names
    keys = ["log"]
    if where == "joint":
        keys = list(joints)
    elif where == "pair":
        keys = [
            f"{joint}<-{other}"
            for limb in assembly.model.limbs.values()
            for joint, other in zip(limb.joint_names[:-1], limb.joint_names[1:], strict=True)
        ]
    if not keys:
        raise BadInput(f"no joint of {assembly.robot.name} has a neighbour")
    entries: list[AppliedEffect] = []
    for key in keys:
        ends = {symbol: float(random.choice([low, high])) for symbol, low, high in bounds}
        entries.append(applied(name, port, key, **ends))
    return replace(assembly, patch=patch_of(assembly.robot.name, entries))


def judged(robots: Robots, seed: int, number: int, folder: Path, *, unpaid: bool) -> dict[str, Any]:
    """One line of the file: a task refused, or by how much its run broke or kept its bounds."""
    world = WORLDS[number // len(ROBOTS) % len(WORLDS)]
    line: dict[str, Any] = {"number": number, "world": world.name}
    drawn, _ = robots.draw(seed, number)
    if drawn is None:
        return line | {"refused": "no posture free of collisions"}
    try:
        assembly = assembled(drawn, folder)
        refuse_infeasible(assembly)
        if world.sensor is not None:
            assembly = wrong_sensor(np.random.default_rng([seed, number, 2]), assembly, world.sensor)
    except (BadInput, np.linalg.LinAlgError) as error:
        return line | {"refused": str(error).splitlines()[0]}
    books = carry_out(assembly, world, seed, number, unpaid=unpaid)
    return line | {
        "broken_claim": max(0.0, -books.least_margin),
        "broken_ledger": max(0.0, books.largest_error),
        "bound": books.largest_bound,
        "work": books.plant.motor_work,
        "cycles": books.cycles,
        "reason": books.supervisor.reason,
    }


def carry_out(assembly: Assembly, world: World, seed: int, number: int, *, unpaid: bool) -> Books:
    """Runs a task in a world, and keeps the books."""
    random = np.random.default_rng([seed, number, 1])
    poor = assembly.tank.floor + float(random.uniform(0.1, 1.0))
    assembly = replace(assembly, tank=replace(assembly.tank, initial=poor))
    backend = sim_backend(assembly, number)
    if world.pumping:
        n = assembly.model.n
        backend.plant.torques.append(Pushes(random, n, random.uniform(2.0, 12.0), random.uniform(1.0, 6.0)))
    robot = UnreliableRobot(backend, number, **world.states) if world.states else backend
    books = Books(Supervisor(assembly), backend.plant)
    first = backend.start()
    books.supervisor.start(first)
    if unpaid:
        books.supervisor.controller.tank.floor = -1e9
    options: dict[str, Any] = {"duration": None, "paced": False, "read_only": False}
    with no_collections():
        run_loop(books.supervisor, robot, first.state, books.watch, Interrupt(), **options)
    return books


def table(lines: list[dict[str, Any]]) -> Table:
    """The figures of a file, one row per world."""
    shown = Table(title="work of the controller against what was paid for")
    for column in (
        "world",
        "runs",
        "claim broken",
        "worst [J]",
        "ledger broken",
        "worst [J]",
        "bound, worst [J]",
    ):
        shown.add_column(column, justify="left" if column == "world" else "right")
    for world in WORLDS:
        ran = [line for line in lines if line["world"] == world.name and "refused" not in line]
        if ran:
            shown.add_row(
                world.name, str(len(ran)), *_broken(ran, "claim"), *_broken(ran, "ledger"), _worst(ran)
            )
    return shown


def _broken(ran: list[dict[str, Any]], what: str) -> Iterator[str]:
    """In how many runs a bound was broken, and by how much at most."""
    excess = [line[f"broken_{what}"] for line in ran]
    yield str(sum(e > ROUNDING for e in excess))
    yield f"{max(excess):.1e}"


def _worst(ran: list[dict[str, Any]]) -> str:
    return f"{max(line['bound'] for line in ran):.2f}"


def main() -> int:
    """Runs what is missing, and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1000, help="accepted tasks to run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/adversarial-runs.jsonl"))
    parser.add_argument("--unpaid", action="store_true", help="without the tank: the claim must break")
    options = parser.parse_args()
    lines = lines_of(options.out)
    robots = Robots(ROBOTS)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    ran = sum("refused" not in line for line in lines)
    with tempfile.TemporaryDirectory() as folder, options.out.open("a") as file:
        while ran < options.runs:
            line = judged(robots, options.seed, len(lines), Path(folder), unpaid=options.unpaid)
            lines.append(line)
            ran += "refused" not in line
            print(json.dumps(line), file=file, flush=True)
    Console().print(table(lines))
    print(f"tasks drawn {len(lines)}, accepted and run {ran}")
    sound = {world.name for world in WORLDS if world.sound}
    broken = [
        line
        for line in lines
        if line["world"] in sound
        and "refused" not in line
        and max(line["broken_claim"], line["broken_ledger"]) > ROUNDING
    ]
    for line in broken[:20]:
        print(
            f"  {line['number']} {line['world']}: {line['broken_claim']:.2e} J, {line['broken_ledger']:.2e} J"
        )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
