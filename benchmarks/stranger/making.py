# SPDX-License-Identifier: BSD-3-Clause
"""Makes a case: simulates it, checks by physics that what was planted shows, and writes what a user has."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.assembly import assemble, rotors_of
from benchmarks.stranger.engine import Arm
from benchmarks.stranger.machine import DoesNotFollowError, Trace, gains, run
from benchmarks.stranger.motions import REST, TICK, Motion, draw_motion
from benchmarks.stranger.outside import draw_outside
from benchmarks.stranger.plan import Plan
from benchmarks.stranger.planting import KINDS, Planted, Scene, draw
from benchmarks.stranger.recorder import Distortion, lagged, map_text, table, write
from benchmarks.stranger.robots import as_built, joints_of, nominal
from benchmarks.stranger.sizes import Pilot, pilot, rms

Array = NDArray[np.float64]

LEAST, MOST = 0.04, 0.40


@dataclass
class Made:
    """A case that was simulated, not yet written."""

    plan: Plan
    root: ET.Element
    real: ET.Element
    model: Arm
    planted: list[Planted]
    traces: list[Trace]
    clean: dict[str, float]


def make(plan: Plan) -> Made | None:
    """Draws until what was drawn is a machine that somebody would use, and what is wrong with it matters.

    None where that was not so in six draws: then another user, with another arm, is drawn.
    """
    for draw_number in range(6):
        made = _attempt(plan, np.random.default_rng(plan.seed + 1 + 1000 * draw_number))
        if made is not None:
            return made
    return None


def _attempt(plan: Plan, rng: np.random.Generator) -> Made | None:
    """Draws links, motions and effects, and simulates; sizes are corrected twice if they came out wrong."""
    root = nominal(plan.maker)
    real = as_built(root, rng)
    model = Arm(root)
    motions = _motions(plan, rng)
    planted = _draw(plan, root, model, pilot(model, motions), rng)
    if len(planted) > 1 and not all(_alone(plan, p, real, model, motions) for p in planted):
        return None
    for _ in range(4):
        traces = simulate(plan, real, model, planted, motions)
        if traces is None:
            return None
        wanted = [_correction(plan, p, traces, Arm(real), planted) for p in planted]
        if len(planted) > 1 or all(factor == 1.0 for factor in wanted):
            shares = residual_shares(plan, traces, Arm(real), planted)
            worst = {k: float(v.max()) for k, v in shares.items()}
            return Made(plan, root, real, model, planted, traces, worst)
        for p, factor in zip(planted, wanted, strict=True):
            p.grow(factor)
    return None


def _alone(plan: Plan, p: Planted, real: ET.Element, model: Arm, motions: list[Motion]) -> bool:
    """Gives one of several effects a size at which it matters by itself, in the recording that it is in."""
    number = int(p.values.get("recording", 0.0))
    if "start" not in p.values:
        motions = [_begun(motions[0], 12.0)]
    for _ in range(4):
        traces = simulate(plan, real, model, [p], motions, number)
        if traces is None:
            return False
        factor = _correction(plan, p, traces, Arm(real), [p])
        if factor == 1.0:
            p.alone = dict(p.shown)
            return True
        p.grow(factor)
    return False


def _begun(m: Motion, seconds: float) -> Motion:
    """The first part of a motion."""
    count = round((REST + seconds) / TICK)
    return Motion(m.q[:count], m.v[:count], m.a[:count])


def _motions(plan: Plan, rng: np.random.Generator) -> list[Motion]:
    motions = [draw_motion(kind, plan.maker, plan.seconds, rng) for kind in plan.motions]
    if plan.repeats:
        motions[1] = motions[0]
        if len(motions) >= 6:
            motions[3] = motions[2]
    return motions


def _draw(plan: Plan, root: ET.Element, model: Arm, p: Pilot, rng: np.random.Generator) -> list[Planted]:
    """Effects at joints where their torques stand out of the sensors' noise; two effects at two joints."""
    noise = np.array(plan.sensors.torque_noise)
    loud = [j for j in range(model.n) if p.span[j] > 30.0 * noise[j]] or [int(np.argmax(p.span / noise))]
    out: list[Planted] = []
    for effect in plan.effects:
        heavy = effect in ("encoder_offset", "eccentric_encoder", "link_inertia")
        may = [j for j in loud if not heavy or j > 0] or [1]
        free = [j for j in may if not any(j in q.joints for q in out)] or may
        if effect in ("joint_elasticity", "backlash"):
            free = [1]
        if effect in ("command_delay", "actuator_lag"):
            free = sorted(free, key=lambda j: float(p.span[j] / rms(p.rates)[j]))[:2]
        if effect == "torque_saturation":
            free = [0]  # no weight hangs on it that would fall
        share = float(np.exp(rng.uniform(np.log(0.055), np.log(0.2))))
        control = gains(
            plan.controller, model, np.array(plan.maker.middle), plan.omega, np.zeros((model.n, model.n)), ""
        )
        scene = Scene(
            plan.maker, root, model, p, control, plan.sensors.channels, int(rng.choice(free)), share,
            len(plan.motions), plan.seconds, plan.rate, loud, rng,
        )  # fmt: skip
        out.append(draw(effect, scene) if effect in KINDS else draw_outside(effect, scene))
    return out


def simulate(
    plan: Plan,
    real: ET.Element,
    model: Arm,
    planted: list[Planted],
    motions: list[Motion],
    only: int | None = None,
) -> list[Trace] | None:
    """All recordings (or one), each from rest, with a machine whose laws have no memory of the one before.

    None if the arm did not follow, or was shaken by its own controller.
    """
    rotors = rotors_of(planted, model.n)
    control = gains(plan.controller, model, np.array(plan.maker.middle), plan.omega, rotors, plan.gravity)
    out = []
    for number, motion in enumerate(motions):
        if only not in (None, number):
            continue
        machine, seed = assemble(real, model, planted), plan.seed + 17 * number
        try:
            out.append(run(machine, control, motion, plan.rate, number, seed))
        except DoesNotFollowError:
            return None
    return out


def residual_shares(plan: Plan, traces: list[Trace], links: Arm, planted: list[Planted]) -> dict[str, Array]:
    """What every comparison that the channels allow is off by, joint by joint, over the joint's range there.

    The reference are the real links without anything planted; no noise is in it. The larger of the rms and
    half of the 98th percentile is taken, so that what is there for a while counts as well.
    """
    off: dict[str, list[Array]] = {}
    span: dict[str, list[Array]] = {}
    d = distortion(planted)
    for trace in traces:
        every = max(1, plan.rate // 100)
        stretch = 1.0 if d.apart else 1.0 + d.ppm * 1e-6
        need = links.torque(trace.q[::every], trace.v[::every], trace.a[::every] / stretch**2)
        pairs = _compared(plan, trace, d, every, need)
        if plan.sensors.velocity == "observer":
            pairs["velocity"] = (_reported(trace, d, plan.rate)[::every], trace.v[::every] / stretch)
        for name, (had, wanted) in pairs.items():
            off.setdefault(name, []).append(had - wanted)
            span.setdefault(name, []).append(wanted)
    return {name: _share(parts, np.ptp(np.concatenate(span[name]), axis=0)) for name, parts in off.items()}


def _share(parts: list[Array], ranges: Array) -> Array:
    """Of the recording in which it is largest."""
    sizes = [np.maximum(rms(x), 0.5 * np.percentile(np.abs(x), 98, axis=0)) for x in parts]
    share: Array = np.max(sizes, axis=0) / np.maximum(ranges, 1e-9)
    return share


def _compared(
    plan: Plan, trace: Trace, d: Distortion, every: int, need: Array
) -> dict[str, tuple[Array, Array]]:
    channels = plan.sensors.channels
    pairs: dict[str, tuple[Array, Array]] = {}
    for letter, effort in (("S", trace.sensor), ("M", trace.motor)):
        if letter in channels:
            read = effort
            if d.apart:
                source = trace.t - d.late - trace.t * d.ppm * 1e-6
                read = np.column_stack([np.interp(source, trace.t, e) for e in effort.T])
            pairs["links"] = (read[::every], need)
            if "C" in channels:
                pairs["drive"] = (trace.asked[::every], read[::every])
    if channels == "C":
        pairs["links"] = (trace.asked[::every], need)
    return pairs


def _reported(trace: Trace, d: Distortion, rate: int) -> Array:
    v = trace.v.copy()
    for j, seconds in d.lags.items():
        v[:, j] = lagged(v[:, j], seconds * rate)
    return v


def _correction(plan: Plan, p: Planted, traces: list[Trace], links: Arm, planted: list[Planted]) -> float:
    """Factor by which an effect should grow, by the comparison that shows it most at its joints."""
    shares = residual_shares(plan, traces, links, planted)
    joints = p.joints or p.loud
    if p.effect in ("payload", "external_contact", "link_inertia"):
        joints = p.loud
    elif p.effect in ("crosstalk", "transmission_coupling"):
        joints = p.joints[:1]
    p.shown = {name: float(x[joints].max()) for name, x in shares.items()}
    most = max(p.shown.values())
    least = 0.012 if p.effect == "clock_drift" else LEAST
    if least <= most <= MOST:
        return 1.0
    return float(np.clip((0.06 if most < least else 0.25) / max(most, 1e-6), 0.3, 1.6))


def distortion(planted: list[Planted]) -> Distortion:
    """What the recorder does wrong; an observer's own lag is a fifth of a millisecond."""
    lags = {p.joints[0]: p.values["T"] for p in planted if p.effect == "velocity_filter_lag"}
    for p in planted:
        if p.effect == "clock_drift":
            return Distortion(lags, p.values["ppm"], bool(p.values["apart"]), p.values["T"])
    return Distortion(lags)


def write_case(made: Made, out: Path) -> None:
    """Recordings, description, map and arguments in one folder; the truth in another."""
    plan, rng = made.plan, np.random.default_rng(made.plan.seed + 2)
    folder, joints, s = out / "cases" / plan.name, joints_of(made.root), plan.sensors
    folder.mkdir(parents=True, exist_ok=True)
    ET.ElementTree(made.root).write(folder / "robot.urdf")
    amps = [round(float(r) * float(rng.uniform(0.08, 0.15)), 4) for r in plan.maker.rated]
    files: list[str] = []
    quantities: list[str] = []
    for number, trace in enumerate(made.traces):
        stamps, columns = table(trace, s, distortion(made.planted), rng)
        files.append(f"run{number + 1}.csv")
        quantities = list(columns)
        write(folder / files[-1], stamps, columns, joints, s, amps)
    if s.style != "native":
        (folder / "map.yaml").write_text(map_text(joints, s, quantities, plan.gravity, amps))
    (folder / "command.json").write_text(json.dumps(_arguments(plan, files, quantities), indent=1))
    (out / "sealed").mkdir(exist_ok=True)
    (out / "sealed" / f"{plan.name}.json").write_text(json.dumps(_truth(made, joints), indent=1))


def _arguments(plan: Plan, files: list[str], quantities: list[str]) -> list[str]:
    """What a sensible user types behind `impedance diagnose`, in the case's folder."""
    last = files[-1:] if plan.holdout else []
    arguments = [f for f in files if f not in last] + ["--urdf", "robot.urdf"]
    for file in last:
        arguments += ["--holdout", file]
    if plan.sensors.style != "native":
        arguments += ["--map", "map.yaml"]
    else:
        if "effort" in quantities:
            arguments += ["--effort-source", "joint_sensor" if "S" in plan.sensors.channels else "motor"]
        arguments += ["--gravity-compensation", plan.gravity]
    for side in plan.said:
        arguments += ["--encoder", side]
    return arguments


def _truth(made: Made, joints: list[str]) -> dict[str, Any]:
    plan = made.plan
    effects = [
        {
            "effect": p.effect,
            "joints": [joints[j] for j in p.joints],
            "place": p.place,
            "link": p.link,
            "values": p.values,
            "outside": p.outside,
            "shown": p.shown,
            "alone": p.alone,
        }
        for p in made.planted
    ]
    setting = {
        "robot": plan.maker.name,
        "controller": plan.controller,
        "gravity": plan.gravity,
        "channels": plan.sensors.channels,
        "velocity": plan.sensors.velocity,
        "style": plan.sensors.style,
        "rate": plan.rate,
        "seconds": plan.seconds,
        "motions": list(plan.motions),
        "repeats": plan.repeats,
        "holdout": plan.holdout,
    }
    return {"case": plan.name, "block": plan.block, "effects": effects, "setting": setting, "off": made.clean}
