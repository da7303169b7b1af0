# SPDX-License-Identifier: BSD-3-Clause
"""The passivity claim where it counts: the plant's own motor port, integrated along the plant's own states.

    integral of tau_applied . dtheta  <=  T_0 + U_0 - r U        at every instant, against any environment

The plant integrates the left side itself, in steps a quarter of a millisecond long, from rotor angles that no sensor
ever saw; the right side is what the ledger in the loop claims. Run with ``-s`` to see the numbers.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.protocol import Backend
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.spec.task import SurfaceSpec
from tests.support.adversity import Books, Pushes, Random

ROUNDING = 1e-6
"""Of the plant's quadrature of its own work [J]."""

TASK = """
format: 1
name: adversity
robot: baxter
arms:
  right:
    posture: {s0: 0.2706, s1: -0.4171, e0: 0.8304, e1: 1.4871, w0: -0.9774, w1: 0.9511, w2: -2.5284}
    joint_bias: {stiffness: {s0: 5, s1: 10, e0: 5, e1: 5, w0: 2, w1: 2, w2: 1}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 300, y: 200, z: 100, rx: 8, ry: 8, rz: 8}
        damping_ratio: 0.7
        axes: {z: {force: FORCE, speed_limit: 0.3}}
  left: {mirror: right}
safety: {tank: {initial: 1, max: 10, floor: 0.05}}
phases:
PHASES
"""


def phases(random: Random, count: int) -> str:
    """Equilibria that jump: 5 to 15 cm in a few hundredths of a second, at gains that change too."""
    lines = []
    for k in range(count):
        x, y, z = np.array([0.6, -0.3, 0.1]) + 0.1 * random.normal(size=3)
        targets = f"right.hand: {{x: {x:.3f}, z: {z:.3f}}}, left.hand: {{y: {-y:.3f}, z: {z:.3f}}}"
        soft = f"{{x: {random.uniform(50, 300):.0f}, y: 100, z: 50, rx: 5, ry: 5, rz: 5}}"
        lines.append(
            f"  - {{name: p{k}, duration: {random.choice([0.05, 0.2, 0.4])}, equilibrium: {{{targets}}},"
            f" stiffness: {{right.hand: {soft}}}}}"
        )
    return "\n".join(lines)


def random_surfaces(random: Random) -> tuple[SurfaceSpec, ...]:
    height = random.uniform(-0.2, 0.1)
    hard, grip = float(random.choice([2e3, 1e4, 2e4])), random.uniform(0.0, 0.8)
    tilt = tuple((0.1 * random.normal(size=3)).tolist())
    return (SurfaceSpec("plane", height, None, tilt, None, hard, 30.0, grip),)


def run_in_world(
    folder: Path,
    seed: int,
    *,
    rate: float = 1000.0,
    noise: bool = True,
    tank: float = 0.6,
    force: float = -8.0,
    push: float = 6.0,
    greed: float = 3.0,
    tamper: Callable[[Controller], None] = lambda controller: None,
    rigid_books: bool = False,
    jumps: bool = True,
    more: str = "",
    compensate: Path | None = None,
    between: Callable[[SimBackend], Backend] = lambda robot: robot,
) -> Books:
    """Runs a random task in a random world, to its end or to a stop."""
    random = np.random.default_rng(seed)
    path = folder / f"adversity-{seed}.yaml"
    steps = phases(random, 4) if jumps else "  - {name: stay, duration: 1.0}"
    if more:
        steps = steps.replace("equilibrium: {", "equilibrium: {grip: {y: 0.4, z: 0.05, rx: 0.2}, ")
    text = TASK.replace("safety:", f"{more}safety:")
    path.write_text(text.replace("FORCE", str(force)).replace("PHASES", steps))
    assembly = assemble(str(path), effects=None, compensate=compensate, rate=rate, scale=1.0, arm=None)
    settings = replace(assembly.tank, initial=tank)
    if rigid_books:
        # A ledger of tau . dq, as if the springs between rotor and link were rigid.
        settings = replace(settings, compliance=np.zeros(assembly.model.n))
    assembly = replace(assembly, tank=settings)
    surfaces = random_surfaces(random) if jumps else ()
    plant = Plant(assembly.model, surfaces, None, PlantOptions(rate=rate, seed=seed, noise=noise))
    plant.torques.append(Pushes(random, assembly.model.n, push, greed))
    backend = SimBackend(plant, assembly.modules.posture, assembly.period)
    books = Books(Supervisor(assembly), plant)
    first = backend.start()
    books.supervisor.start(first)
    tamper(books.supervisor.controller)
    options = {"duration": 0.8, "paced": False, "read_only": False}
    run_loop(books.supervisor, between(backend), first.state, books.watch, Interrupt(), **options)
    return books


WORLDS = [
    {"seed": 1, "tank": 0.3},
    {"seed": 2, "rate": 500.0, "tank": 0.5},
    {"seed": 3, "noise": False, "tank": 0.2},
    {"seed": 4, "push": 15.0, "tank": 0.8},
    {"seed": 5, "noise": False, "rate": 500.0, "push": 12.0, "tank": 1.0},
    {"seed": 8, "force": -20.0, "tank": 2.0},
]


def check_books(seen: Books) -> None:
    assert seen.least_margin >= -ROUNDING
    assert seen.largest_error <= ROUNDING


@pytest.mark.parametrize("world", WORLDS, ids=lambda world: f"seed{world['seed']}")
def test_work_at_the_motors_stays_within_the_claim(tmp_path: Path, world: dict) -> None:
    seen = run_in_world(tmp_path, **world)
    print(
        f"\n{world}: {seen.cycles} cycles, {seen.supervisor.reason or 'done'}\n"
        f"  least margin of the claim {seen.least_margin:.4f} J, sensing bound {seen.largest_bound:.4f} J,"
        f" work {seen.plant.motor_work:.3f} J, tank {seen.supervisor.controller.tank.level:.3f} J"
    )
    assert seen.cycles > 100
    check_books(seen)
    if not world.get("noise", True):
        assert abs(seen.plant.motor_work) > 0.01


JOINED = """
between:
  - name: grip
    frames: [left.hand, right.hand]
    expressed_in: right.hand
    stiffness: {x: 300, y: 100, z: 200, rx: 8, ry: 4, rz: 8}
    damping_ratio: 0.7
obstacles:
  - {name: ball, shape: sphere, position: [0.62, -0.26, 0.12], size: [0.02], distance: 0.1, stiffness: 600, damping: 20,
     guards: [right.hand, left.hand]}
"""


@pytest.mark.parametrize("world", [WORLDS[0], WORLDS[2], WORLDS[4]], ids=lambda world: f"seed{world['seed']}")
def test_it_does_with_a_spring_between_the_arms_and_an_obstacle(tmp_path: Path, world: dict) -> None:
    seen = run_in_world(tmp_path, **world, more=JOINED)
    efforts = seen.supervisor.controller.cycle.modules
    assert seen.cycles > 100 and np.any(efforts.between.effort)
    check_books(seen)


def ignore_the_tank(controller: Controller) -> None:
    """The books go on, but there is always a thousand joules to spend: nothing is scaled, nothing relaxed."""
    controller.tank.floor = -1000.0


def test_without_scaling_the_claim_breaks(tmp_path: Path) -> None:
    """The same world, the same books, but the torque leaves unscaled: it does more work than the tank holds."""
    world = {"tank": 0.1, "force": -20.0, "push": 0.0, "greed": 2.0, "jumps": False}
    broken = run_in_world(tmp_path, 21, **world, tamper=ignore_the_tank)
    kept = run_in_world(tmp_path, 21, **world)
    print(f"\nleast margin unscaled {broken.least_margin:.3f} J, scaled {kept.least_margin:.4f} J")
    assert broken.least_margin < -0.1
    assert kept.least_margin >= -ROUNDING


def test_books_at_the_links_miss_what_the_motors_do(tmp_path: Path) -> None:
    world = {"noise": False, "tank": 2.0, "push": 10.0, "jumps": False}
    wrong, right = (run_in_world(tmp_path, 31, **world, rigid_books=rigid) for rigid in (True, False))
    print(
        f"\nbooks off by {wrong.largest_error:.4f} J beyond their bound at the links ({wrong.cycles} cycles),"
        f" {right.largest_error:.1e} J at the motors; least margin {wrong.least_margin:.2f} J and"
        f" {right.least_margin:.2f} J"
    )
    check_books(right)
    assert wrong.largest_error > 1e-3
