# SPDX-License-Identifier: BSD-3-Clause
"""Pushes the box of ``box-hold`` out of two hands: does the plant stay finite, and does it create energy?

Run from the repository: ``python -m benchmarks.plant.pushed_objects [--cases N] [--seed S]``. First eight pushes along
the axes, then N random ones: force (5 to 100 N) in any direction with a moment, start, duration, squeeze, friction,
mass, size and shape of the object, control rate. The whole controller runs; a floor lies 0.6 m below the hands.
"""

from __future__ import annotations

import argparse
import dataclasses
from dataclasses import dataclass

import numpy as np

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import ImpedanceError
from impedance_modules.plant.energy_balance import EnergyBook
from impedance_modules.plant.plant import Plant
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.spec.task import ObjectSpec, PushSpec, SurfaceSpec

DURATION = 1.2
"""Of a run [s]; braking and settling come on top."""

FIXED = ((0, 0, -15), (0, 0, -60), (0, 40, 0), (60, 0, 0))
"""Forces [N] of the first cases, each at 1000 and at 500 Hz."""

FLOOR = SurfaceSpec(
    "plane", height=-0.6, position=None, size=None, stiffness=20000.0, damping=50.0, friction=0.3,
    rotation=(0.0, 0.0, 0.0),
)  # fmt: skip


@dataclass
class Seen:
    """What one run came to.

    Attributes:
        speed: Largest of the object [m/s].
        motor: Largest of a motor [rad/s].
        gained: Most energy that the grasp gave beyond what it had taken, in any millisecond [J].
        missing: Energy that no term of the books accounts for, largest over the run [J].
        turned: Energy that went through the books [J].
        outside: Largest excess over the friction cone, relative.
        lost: How often a hand let go.
        regrasped: How often one touched again.
        ending: Why the run ended.
    """

    speed: float = 0.0
    motor: float = 0.0
    gained: float = 0.0
    missing: float = 0.0
    turned: float = 0.0
    outside: float = 0.0
    lost: int = 0
    regrasped: int = 0
    ending: str = ""


class Watcher:
    """Looks at a plant after each control period."""

    def __init__(self, plant: Plant) -> None:
        self.seen, self._plant, self._begin = Seen(), plant, plant.energy()
        self._dissipated = 0.0
        self._touching = [True] * int(np.sum(plant.state.hands["holds"]))

    def look(self) -> None:
        """Takes the worst so far."""
        plant, seen = self._plant, self.seen
        seen.speed = max(seen.speed, float(np.linalg.norm(plant.state.start.object_velocity)))
        seen.motor = max(seen.motor, float(np.abs(plant.state.start.motor_velocity).max()))
        self._energy(plant.energy())
        for i, hand in enumerate(plant.state.hands):
            self._grasp(i, hand)

    def _energy(self, book: EnergyBook) -> None:
        seen, lost = self.seen, book.dissipated(self._begin)
        seen.gained = max(seen.gained, self._dissipated - lost["grasp"])
        self._dissipated = lost["grasp"]
        works = abs(book.command_work) + abs(book.robot_work) + abs(book.push_work)
        seen.turned = max(seen.turned, works + sum(abs(value) for value in lost.values()))
        seen.missing = max(seen.missing, abs(book.imbalance(self._begin)))

    def _grasp(self, i: int, hand: np.void) -> None:
        seen, state = self.seen, self._plant.state
        wrench = state.grasp_wrench[i]
        touching = bool(wrench.any())
        seen.lost += self._touching[i] and not touching
        seen.regrasped += touching and not self._touching[i]
        self._touching[i] = touching
        if touching:
            # The force of the last stage; the object has not turned since.
            normal = state.body.rotation_now @ hand["normal"]
            pressed = -float(wrench[:3] @ normal)
            rub = float(np.linalg.norm(wrench[:3] + pressed * normal))
            seen.outside = max(seen.outside, rub / (float(hand["friction"]) * pressed) - 1.0)


def run(assembly: Assembly) -> Seen:
    """Runs a task with its pushes and watches the plant."""
    backend, supervisor = sim_backend(assembly, 0), Supervisor(assembly)
    first = backend.start()
    supervisor.start(first)
    watcher, advance = Watcher(backend.plant), backend.plant.advance

    def watched(command: np.ndarray | None) -> None:
        advance(command)
        watcher.look()

    backend.plant.advance = watched
    end = {"duration": DURATION, "paced": False, "read_only": False}
    run_loop(supervisor, backend, first.state, lambda *_: None, Interrupt(), **end)
    watcher.seen.ending = supervisor.reason
    return watcher.seen


def pushed(rate: float, push: PushSpec, **numbers: object) -> Assembly:
    """Assembles ``box-hold`` with a push, a floor, and another object."""
    assembly = assemble("box-hold", effects=None, rate=rate, scale=1.0, arm=None)
    held: ObjectSpec = dataclasses.replace(assembly.task.object, **numbers)
    task = dataclasses.replace(assembly.task, pushes=(push,), environment=(FLOOR,), object=held)
    return dataclasses.replace(assembly, task=task)


def random_case(rng: np.random.Generator) -> Assembly:
    """Draws a push, an object and a rate; the controller believes that it holds its own box."""
    force = rng.normal(size=3)
    force *= np.exp(rng.uniform(np.log(5.0), np.log(100.0))) / np.linalg.norm(force)
    moment = rng.normal(scale=0.3, size=3)
    rise, hold, fall = rng.uniform(0.0, 0.1), rng.uniform(0.02, 1.0), rng.uniform(0.0, 0.1)
    push = PushSpec("object", (*force, *moment), float(rng.uniform(0.05, 0.4)), rise, hold, fall)
    width = 0.2  # what the hands are apart
    shape = str(rng.choice(["box", "cylinder", "sphere"]))
    size = {
        "box": (rng.uniform(0.1, 0.4), width, rng.uniform(0.1, 0.4)),
        "cylinder": (width, rng.uniform(0.1, 0.4)),
        "sphere": (width,),
    }[shape]
    return pushed(
        float(rng.choice([400.0, 500.0, 800.0, 1000.0])),
        push,
        mass=float(np.exp(rng.uniform(np.log(0.3), np.log(3.0)))),
        size=size,
        shape=shape,
        friction=float(rng.uniform(0.1, 1.2)),
        squeeze=float(rng.uniform(0.0, 40.0)),
        carry_weight=bool(rng.random() < 0.7),
    )


def told(seen: Seen) -> str:
    """One line for one run."""
    return (
        f"object {seen.speed:6.2f} m/s, motors {seen.motor:5.2f} rad/s, let go {seen.lost}, touched again"
        f" {seen.regrasped}, gained {seen.gained:.1e} J, unaccounted {seen.missing:.1e} of {seen.turned:.1f} J,"
        f" out of the cone {seen.outside:.1e}; {seen.ending[:60]}"
    )


def main() -> None:
    """Prints one line per fixed push, and the worst of the random ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    for force in FIXED:
        for rate in (1000.0, 500.0):
            push = PushSpec("object", (*map(float, force), 0.0, 0.0, 0.0), 0.1, 0.05, 1.0, 0.0)
            print(f"{force} N at {rate:g} Hz: {told(run(pushed(rate, push)))}", flush=True)
    found, refused, broken = [], 0, 0
    for k in range(asked.cases):
        assembly = random_case(np.random.default_rng([asked.seed, k]))
        try:
            seen = run(assembly)
        except ImpedanceError as error:
            refused += 1
            print(f"case {k}: refused: {error}", flush=True)
            continue
        broken += "not finite" in seen.ending
        found.append((k, seen))
    print(f"{asked.cases} random cases: {refused} refused before they began, {broken} not finite")
    for name in ("speed", "motor", "gained", "missing", "outside", "lost", "regrasped"):
        k, worst = max(found, key=lambda item: getattr(item[1], name))
        print(f"largest {name}: {getattr(worst, name):.3g} (case {k}: {told(worst)})")
    shares = [seen.missing / seen.turned for _, seen in found]
    print(f"unaccounted of turned over: median {np.median(shares):.1e}, largest {max(shares):.1e}")
    print(
        f"let go in {sum(seen.lost > 0 for _, seen in found)}, again in {sum(seen.regrasped > 0 for _, seen in found)}"
    )


if __name__ == "__main__":
    main()
