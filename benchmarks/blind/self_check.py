# SPDX-License-Identifier: BSD-3-Clause
"""Checks the generator itself: `python -m benchmarks.blind.self_check`; every check can fail.

The scoring is checked on made-up truth, one case per block, with a tool that is always right and one that is always
wrong.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind.applied_answer import apply_answer
from benchmarks.blind.arm_model import ROBOT_FOLDER, Joints, hand_of, read_arm, read_drive, write_mjcf
from benchmarks.blind.blocks import SEALED, SEALS, make, seal_of
from benchmarks.blind.case import Planted, draw_bench, measure, plant_effect, rich_episodes
from benchmarks.blind.catalogue import CATALOGUE, OPEN_SET
from benchmarks.blind.excitation import Motion, inverse_dynamics
from benchmarks.blind.figures import FIGURES
from benchmarks.blind.injection import Injection
from benchmarks.blind.logs import record
from benchmarks.blind.noise_scale import NoiseScale
from benchmarks.blind.plant import Arm, Noise, rigid_model, simulate
from benchmarks.blind.residual import residual
from benchmarks.blind.run import ANSWERS
from benchmarks.blind.score import check_seals, judge, score_all

Array = NDArray[np.float64]

Result = tuple[bool, str]
PARTLY_STATED = ("external_contact", "torque_ripple", "link_inertia", "clock_drift")
"""Effects whose truth leaves out what would be needed to apply it: pushes, phase, moments, which of the clocks."""
TRUE: dict[str, Any] = {
    "effect": "viscous_friction",
    "joints": ["left_e1"],
    "port": "actuator",
    "parameters": {"left_e1": {"fv": 2.0}},
    "also": [],
    "size": 3.0,
    "size_with_inertias": 3.0,
}
CAUSE = {
    "effect": "viscous_friction",
    "joints": ["left_e1"],
    "parameters": {"left_e1": {"fv": {"value": 2.02, "std": 0.05, "unit": "N.m.s/rad"}}},
    "equivalent": [],
}
WRONG = {"effect": "backlash", "joints": ["left_w2"], "parameters": {}, "equivalent": []}
SECOND = {**TRUE, "effect": "torque_offset", "parameters": {"left_e1": {"c": 1.0}}}
BENCH = {"noise_level": 1.0, "inertia_error": 0.01, "side": "left"}
Case = tuple[dict[str, Any], str, list[dict[str, Any]]]


def same_dynamics() -> Result:
    """M, C and g of the exact nominal arm equal pinocchio's."""
    model = pin.buildModelFromUrdf(str(ROBOT_FOLDER / "baxter.urdf"))
    data, rng, worst = model.createData(), np.random.default_rng(0), 0.0
    for side in ("left", "right"):
        joints = [model.joints[model.getJointId(name)] for name in read_drive(side).joints]
        at, to = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints]
        arm = rigid_model(read_arm(side), side)
        q, v, a = np.zeros((3, 50, len(joints)))
        expected = np.zeros_like(q)
        for k in range(50):
            q[k], v[k], a[k] = rng.uniform(-1, 1, (3, len(joints)))
            whole = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
            whole[0][at], whole[1][to], whole[2][to] = q[k], v[k], a[k]
            expected[k] = pin.rnea(model, data, *whole)[to]
        worst = max(worst, float(np.abs(inverse_dynamics(arm, q, v, a) - expected).max()))
    return worst < 1e-10, f"largest difference {worst:.1e} N.m"


def keeps_energy() -> Result:
    """Without damping and gravity the springs, rotors and links together keep their energy."""
    side = "left"
    drive = read_drive(side)
    n = len(drive.joints)
    joints = replace(Joints.nominal(drive), motor_damping=np.zeros(n), damping=np.zeros(n))
    text = write_mjcf(read_arm(side), joints, np.zeros(3), hand_of(side))
    model = mujoco.MjModel.from_xml_string(
        text.replace("<option ", '<option ><flag energy="enable"/></option><option ', 1)
    )
    data = mujoco.MjData(model)
    data.qvel[:] = np.tile(np.random.default_rng(1).uniform(-0.5, 0.5, n), 2)
    data.qpos[n:] += 0.005
    mujoco.mj_forward(model, data)
    energies = []
    for _ in range(4000):
        mujoco.mj_step(model, data)
        energies.append(float(data.energy.sum()))
    drift = (np.mean(energies[-400:]) - np.mean(energies[:400])) / energies[0]
    return bool(abs(drift) < 0.02), f"drift in 2 s {100 * drift:.2f} % of {energies[0]:.2f} J"


def nominal_is_silent() -> Result:
    """With exact inertias, no fault and no sensor grid the residual is below 15 % of the noise's rms."""
    bench = draw_bench(np.random.default_rng(2), 1.0)
    fine = replace(bench.arm.drive, position_resolution=1e-9, effort_resolution=1e-9)
    bench = replace(bench, arm=replace(bench.arm, links=bench.arm.believed, drive=fine))
    motion = rich_episodes(bench, np.random.default_rng(3))[0].motion
    model = rigid_model(bench.arm.believed, bench.arm.side)

    def left(noise: Noise | None) -> Array:
        raw = simulate(bench.arm, motion, *bench.gains, noise)
        return residual(record(raw, fine, bench.arm.faults), fine, model)

    quiet, noisy = left(None), left(Noise(4, 1.0))
    ratio = np.sqrt(np.mean(quiet**2, axis=1)) / np.sqrt(np.mean((noisy - quiet) ** 2, axis=1))
    return bool(ratio.max() < 0.15), f"largest residual {ratio.max():.2f} of the noise"


def sizes_hold() -> Result:
    """An effect sized on noiseless runs has that size, within a third, in the noisy logs it goes into."""
    rng = np.random.default_rng(5)
    bench = draw_bench(rng, 1.0)
    episodes = rich_episodes(bench, rng)
    scale = measure(bench, episodes, 6)
    model, drive = rigid_model(bench.arm.believed, bench.arm.side), bench.arm.drive
    lines, fine = [], True
    for effect in ("viscous_friction", "torque_ripple", "crosstalk"):
        one = plant_effect(CATALOGUE[effect], bench, scale, episodes, 3.0, rng)
        changed = one.injection.apply(bench.arm, one.amplitude, 0)
        change = _noisy_change(bench.arm, changed, episodes[0].motion, bench.gains)
        port = ("actuator", "link", "sensor").index(one.size.port)
        column = residual(change[0], drive, model) - residual(change[1], drive, model)
        rms = (
            float(np.sqrt(np.mean(column[port][:, one.size.joint] ** 2))) / scale.noise[port, one.size.joint]
        )
        expected = float(np.hypot(one.size.raw, np.sqrt(2.0)))
        fine &= 0.67 < rms / expected < 1.5
        lines.append(f"{effect} {rms:.1f} of {expected:.1f}")
    return fine, ", ".join(lines)


def _noisy_change(
    clean: Arm, changed: Arm, motion: Motion, gains: tuple[Array, Array]
) -> list[dict[str, Array]]:
    logs = []
    for i, arm in enumerate((changed, clean)):
        logs.append(record(simulate(arm, motion, *gains, Noise(7 + i, 1.0)), arm.drive, arm.faults))
    return logs


def truths_can_be_applied() -> Result:
    """An answer that states the truth, put on by its symbols and signs, leaves under 15 % of the effect's signature."""
    rng = np.random.default_rng(8)
    bench = draw_bench(rng, 1.0)
    episodes = rich_episodes(bench, rng)
    scale = NoiseScale(bench.arm, [episodes[0].motion], bench.gains, 1.0, 9)
    left = {}
    for effect in (name for name in CATALOGUE if name not in PARTLY_STATED):
        planted = plant_effect(CATALOGUE[effect], bench, scale, episodes, 3.0, rng, None, True)
        _, true = scale.signature(partial(_apply_planted, planted))
        _, said = scale.signature(partial(_apply_answered, _as_cause(planted.injection, planted.amplitude)))
        left[effect] = float(np.sqrt(np.sum((true - said) ** 2) / np.sum(true**2)))
    worst = max(left, key=lambda effect: left[effect])
    return left[worst] < 0.15, f"{len(left)} effects; most is left of {worst}, {100 * left[worst]:.1f} %"


def _as_cause(one: Injection, amplitude: float) -> dict[str, Any]:
    parameters = {
        key: {symbol: {"value": value} for symbol, value in symbols.items()}
        for key, symbols in one.parameters(amplitude).items()
    }
    return {"effect": one.effect, "port": one.port, "parameters": parameters}


def _apply_planted(planted: Planted, arm: Arm, episode: int) -> Arm:
    return planted.injection.apply(arm, planted.amplitude, episode)


def _apply_answered(cause: dict[str, Any], arm: Arm, _: int) -> Arm:
    return apply_answer(arm, [cause])[0]


def nothing_leaks() -> Result:
    """Neither files nor names nor metadata of a case carry a word of the truth."""
    words = set(CATALOGUE) | set(OPEN_SET) | {"truth", "amplitude", "seed"}
    with tempfile.TemporaryDirectory() as place:
        made = make("A", 0, "dev", Path(place))[0]
        text = json.dumps(made.shown) + made.name
        for path in (Path(place) / made.name).iterdir():
            schema = pq.read_schema(path)
            text += path.name + str(schema.metadata) + " ".join(schema.names)
        again = make("A", 0, "dev", Path(place))[0]
    found = sorted(word for word in words if word in text)
    same = again.truth == made.truth and again.name == made.name
    return not found and same, f"words found: {found or 'none'}; made twice the same: {same}"


def scorer_is_fair() -> Result:
    """Right answers score full marks in every block, confident wrong ones none, and a changed truth is refused."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place)
        write_made_up_cases(out)
        right = {figure.title: figure.count(judge(out, out / ANSWERS, "impedance")) for figure in FIGURES}
        wrong = {figure.title: figure.count(judge(out, out / ANSWERS, "least-squares")) for figure in FIGURES}
        text = score_all(out, out / ANSWERS)
        (out / SEALED / "A.json").write_text("{}")
        try:
            check_seals(out)
            refused = False
        except ValueError:
            refused = True
    rates = [title for title, value in right.items() if "% (" in value]
    bad = {
        title for title in rates if any(word in title for word in ("alarm", "wrong", "contain", "no answer"))
    }
    good = [title for title in rates if title not in bad]
    bad.discard("no answer at all")
    fair = all(
        right[t].startswith("100.0 %") and wrong[t].startswith("0.0 %") for t in good if "cover" not in t
    )
    fair &= all(right[t].startswith("0.0 %") and wrong[t].startswith("100.0 %") for t in bad)
    return (
        fair and refused and "impedance diagnose" in text,
        f"{len(rates)} rates; changed truth refused: {refused}",
    )


CHECKS: tuple[Callable[[], Result], ...] = (
    scorer_is_fair,
    same_dynamics,
    keeps_energy,
    nominal_is_silent,
    sizes_hold,
    truths_can_be_applied,
    nothing_leaks,
)


def main() -> int:
    """Prints one line per check; returns 1 if any failed."""
    failed = 0
    for check in CHECKS:
        fine, text = check()
        failed += not fine
        print(f"{'ok  ' if fine else 'FAIL'} {check.__name__}: {text}")
    return int(failed > 0)


def write_made_up_cases(out: Path) -> None:
    """Writes truths, seals and the answers of both tools below ``out``."""
    for block, cases in _cases().items():
        sealed = out / SEALED / f"{block}.json"
        sealed.parent.mkdir(parents=True, exist_ok=True)
        truths = {f"{block}{i}": {"block": block, **BENCH, **truth} for i, (truth, _, _) in enumerate(cases)}
        sealed.write_text(json.dumps({"cases": truths}))
        with (out / SEALS).open("a") as file:
            file.write(f"{seal_of(sealed)}  {SEALED}/{block}.json  dev  {len(cases)} cases\n")
        for i, (_, verdict, causes) in enumerate(cases):
            _answer(out / ANSWERS / "impedance", f"{block}{i}", verdict, causes)
            _answer(out / ANSWERS / "least-squares", f"{block}{i}", "explained", [WRONG])


def _cases() -> dict[str, list[Case]]:
    pair = ["viscous_friction", "coulomb_friction"]
    both = [{**CAUSE, "equivalent": [{"effect": "coulomb_friction", "joints": ["left_e1"]}]}]
    other = {**CAUSE, "effect": "torque_offset", "parameters": {}}
    strange = {**TRUE, "effect": "vibration_tone", "parameters": {}}
    return {
        "A": [({"effects": [TRUE]}, "explained", [CAUSE])],
        "B": [({"effects": []}, "no_gap", [])],
        "C": [({"effects": [TRUE, SECOND]}, "explained", [CAUSE, other])],
        "D": [
            ({"effects": [TRUE], "motion": "poor", "pair": pair, "apart": 1.0}, "ambiguous", both),
            ({"effects": [TRUE], "motion": "rich", "pair": pair, "apart": 500.0}, "explained", [CAUSE]),
        ],
        "E": [({"effects": [strange]}, "unexplained", [])],
        "F": [({"effects": [TRUE]}, "partly_explained", [WRONG])],
        "N": [({"effects": [TRUE]}, "explained", [CAUSE])],
        "G": [({"effects": [TRUE]}, "explained", [CAUSE]), ({"effects": []}, "no_gap", [])],
    }


def _answer(folder: Path, name: str, verdict: str, causes: list[dict[str, Any]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.json").write_text(
        json.dumps({"verdict": verdict, "causes": causes, "gap": {"shrink": 0.97}})
    )
    run = {"exit": 0, "seconds": 1.0, "processor_seconds": 1.0, "memory_mb": 200.0, "errors": ""}
    (folder / f"{name}.run.json").write_text(json.dumps(run))


if __name__ == "__main__":
    sys.exit(main())
