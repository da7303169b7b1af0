# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the wide benchmark itself: `python -m benchmarks.wide.self_check`; exit 1 if any fails.

Whether the nominal arm leaves little of its own recording, both engines agree, energy stays, labelled sizes hold in
noisy recordings, every value is drawn, and nothing of the truth is shown.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Joints
from benchmarks.blind.catalogue import CATALOGUE, OPEN_SET
from benchmarks.wide.arms import DOWN, WideArm, draw_arm, rigid
from benchmarks.wide.blocks import second_engine, simulate
from benchmarks.wide.cases import make
from benchmarks.wide.design import DIMENSIONS, RULES, draw_cases
from benchmarks.wide.logs import record
from benchmarks.wide.motions import draw_motions
from benchmarks.wide.mujoco_engine import MujocoEngine, Rigid
from benchmarks.wide.plan import STEP
from benchmarks.wide.size import EDGE, dynamics, motion_of, residuals

Array = NDArray[np.float64]
Result = tuple[bool, str]

BASE = {
    "robot": "ur5", "mount": "tilted", "rate": "200", "stamps": "even", "streams": "command+joint", "gravity": "robot",
    "controller": "impedance", "engine": "mujoco_implicit", "friction": "lugre", "transmission": "rigid",
    "noise": "white", "velocity": "filtered", "motion": "identification", "repeats": "different", "seconds": "8",
    "logs": "1", "known_by": "robot_file",
}  # fmt: skip


def exact(values: dict[str, str], seed: int = 0) -> tuple[WideArm, Array]:
    """Returns an arm whose links are exactly those of its file, and one motion of four seconds."""
    rng = np.random.default_rng(seed)
    arm = draw_arm(values, rng)
    arm = replace(arm, links=arm.believed)
    motions, _ = draw_motions(values, rigid(arm.machine).model, arm.drive, 5.0, 1, rng)
    return arm, motions[0].position


def left_over(values: dict[str, str], seed: int = 0) -> dict[str, float]:
    """Returns, per residual, what the nominal arm leaves of its own recording, at the worst joint.

    In units of the noise, or of a fiftieth of the joint's range, whichever is larger.
    """
    arm, reference = exact(values, seed)
    model, found, ranges = rigid(arm.machine), [], {}
    cut = round(EDGE * float(values["rate"]))
    for noise in (None, seed + 1):
        channels, _ = record(simulate(arm.plan(reference, noise)), arm, None)
        channels["period"] = np.array(1 / float(values["rate"]))
        found.append({name: part[cut:-cut] for name, part in residuals(channels, arm, model).items()})
        if noise is None:
            q, v, a = motion_of(channels["position"], 1 / float(values["rate"]))
            ranges = {"velocity": np.ptp(v[cut:-cut], axis=0)}
            torque = np.ptp(dynamics(model, q, v, a)[cut:-cut], axis=0)
    shares = {}
    for name, part in found[0].items():
        noise_there = np.sqrt(np.mean((found[1][name] - part) ** 2, axis=0))
        unit = np.maximum(noise_there, 0.02 * ranges.get(name, torque))
        shares[name] = float(np.max(np.sqrt(np.mean(part**2, axis=0)) / unit))
    return shares


def nominal_is_silent() -> Result:
    """The nominal arm leaves at most 8 % of the noise, or of a fiftieth of the range, whatever varies."""
    worst, where = 0.0, ""
    for i, drawn in enumerate(islice(draw_cases((11,)), 24)):
        motion = drawn["motion"].replace(
            "teleoperation", "pick_and_place"
        )  # a tremor lies on the band's edge
        values = {**drawn, "motion": motion, "stamps": "even"}
        values["gravity"] = drawn["gravity"].replace("robot_late", "robot")
        for name, share in left_over(values, i).items():
            if share > worst:
                worst, where = share, f"{name}, {values}"
    return worst < 0.08, f"24 draws; most is left of {where}: {100 * worst:.1f} %"


def engines_agree() -> Result:
    """Both engines make the same recording of an arm without noise, with friction and gear, rigid or with springs."""
    worst = {}
    for spring in ("rigid", "spring"):
        arm, reference = exact({**BASE, "transmission": spring})
        faults = arm.faults
        faults.friction["fc"][:, 1], faults.friction["s0"][:, 1] = 3.0, 3000.0
        logs = [simulate(arm.plan(reference, None, engine)) for engine in ("mujoco_implicit", "drake")]
        worst[spring] = [
            float(np.max(np.abs(logs[0].position - logs[1].position))),
            float(np.sqrt(np.mean((logs[0].effort - logs[1].effort) ** 2))),
        ]
    fine = all(position < 5e-4 and effort < 0.1 for position, effort in worst.values())
    text = ", ".join(f"{key} {1e6 * p:.0f} urad, {1e3 * e:.1f} mN.m rms" for key, (p, e) in worst.items())
    return fine, text


def energy_stays() -> Result:
    """A swinging arm without motors and losses keeps its energy, in both integrators of the first engine."""
    worst = {}
    for engine in ("mujoco_implicit", "mujoco_runge_kutta"):
        arm, reference = exact({**BASE, "robot": "planar_3", "engine": engine})
        drive = replace(arm.drive, motor_damping=np.zeros(3))
        plan = replace(arm.plan(reference, None), joints=replace(Joints.nominal(drive)))
        body = MujocoEngine(plan)
        body.start(np.array([0.3, 0.2, -0.4]), np.zeros(3))
        inertia, model = plan.joints.rotor_inertia, Rigid(plan.links, plan.hand, DOWN)

        def energy(body: MujocoEngine = body, model: Rigid = model, inertia: Array = inertia) -> float:
            kinetic = 0.5 * body.v @ ((model.inertia(body.q.copy()) + np.diag(inertia)) @ body.v)
            return float(kinetic + body.energy_of_weight())

        first, most, kinetic = energy(), 0.0, 0.0
        for _ in range(round(2.0 / STEP)):
            body.step(np.zeros(3), np.zeros(3), np.zeros((2, 3)), np.zeros(3))
            most = max(most, abs(energy() - first))
            kinetic = max(kinetic, energy() - body.energy_of_weight())
        worst[engine] = most / kinetic
    return max(worst.values()) < 0.005, ", ".join(f"{key} {100 * part:.3f} %" for key, part in worst.items())


def design_draws_all() -> Result:
    """In 60 cases every value occurs, none of a free dimension thrice as often as another; all rules hold."""
    cases = list(islice(draw_cases((5,)), 60))
    missing = [f"{name}={value}" for name, pool in DIMENSIONS.items() for value in pool
               if value not in {case[name] for case in cases}]  # fmt: skip
    broken = [text for text, rule in RULES if not all(rule(case) for case in cases)]
    robots = Counter(case["robot"] for case in cases)
    return (
        not missing and not broken,
        f"missing {missing or 'none'}, broken {broken or 'none'}; robots {dict(robots)}",
    )


def nothing_leaks() -> Result:
    """Neither files nor names of a case carry a word of the truth; made twice it is the same.

    The robot file is not read: its keys are words of the catalogue, and it is written before anything is wrong.
    """
    truth_words = set(CATALOGUE) | set(OPEN_SET) | {"truth", "amplitude", "seed", "drake", "mujoco", "lugre"}
    with tempfile.TemporaryDirectory() as place:
        made = make("A", 0, "smoke", None, Path(place), simulate)
        text = json.dumps(made.shown) + made.name
        for path in (Path(place) / made.name).rglob("*"):
            if path.suffix == ".parquet":
                schema = pq.read_schema(path)
                text += path.name + str(schema.metadata) + " ".join(schema.names)
            elif path.suffix == ".urdf":
                text += path.name + path.read_text()
        again = make("A", 0, "smoke", None, Path(place), simulate)
    found = sorted(word for word in truth_words if word in text)
    return (
        not found and again.truth == made.truth,
        f"words found: {found or 'none'}; the same twice: {again.truth == made.truth}",
    )


CHECKS: tuple[Callable[[], Result], ...] = (
    design_draws_all,
    engines_agree,
    energy_stays,
    nominal_is_silent,
    nothing_leaks,
)


def main() -> int:
    """Prints one line per check; returns 1 if any failed."""
    failed = 0
    for check in CHECKS:
        fine, text = check()
        failed += not fine
        print(f"{'ok  ' if fine else 'FAIL'} {check.__name__}: {text}", flush=True)
    second_engine().close()
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
