# SPDX-License-Identifier: BSD-3-Clause
"""One case: an arm, its controller, its motions, what is wrong with it, and the files that are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Joints, hand_of, read_arm, read_drive
from benchmarks.blind.bodies import wrong_by
from benchmarks.blind.catalogue import CATALOGUE, SIMPLER
from benchmarks.blind.excitation import RATE, RICH, Motion, PoorShape, choose_centre, poor_motion, rich_motion
from benchmarks.blind.floor import MapError, Surface, task_text
from benchmarks.blind.injection import Draw, Injection, Situation
from benchmarks.blind.logs import record, save
from benchmarks.blind.noise_scale import ALIKE, NoiseScale, Size
from benchmarks.blind.plant import Arm, Noise, rigid_model, simulate
from benchmarks.blind.records import Faults

Array = NDArray[np.float64]

SECONDS = 12.5
"""Of a simulated run; what is logged of it is a little shorter (see `logs.SAMPLES`)."""

SHOWN = 0.4
"""Share of an effect's size that the weakest motion must show: what one motion alone shows, none can confirm."""


@dataclass(frozen=True)
class Episode:
    """One run: its motion, the index of the run that it repeats, and whether it is held out."""

    motion: Motion
    repeats: int | None
    held_out: bool


@dataclass(frozen=True)
class Bench:
    """An arm with its controller before anything is put wrong."""

    arm: Arm
    gains: tuple[Array, Array]
    noise_level: float
    inertia_error: float


@dataclass(frozen=True)
class Planted:
    """An effect with its amplitude, the size it turned out to have, and effects as good as it (`equivalents_of`)."""

    injection: Injection
    amplitude: float
    size: Size
    equivalents: tuple[str, ...] = ()


def draw_bench(rng: np.random.Generator, noise_level: float) -> Bench:
    """Draws a side, the links' true inertias and the controller's gains."""
    side = str(rng.choice(["left", "right"]))
    links, drive = read_arm(side), read_drive(side)
    error = float(rng.uniform(0.0, 0.03))
    faults = Faults.none(len(drive.joints))
    arm = Arm(side, drive, wrong_by(links, error, rng), links, Joints.nominal(drive), faults)
    strong = drive.effort_max > 0.5 * drive.effort_max.max()
    stiffness = np.where(strong, rng.uniform(60, 140), rng.uniform(10, 20)) * rng.uniform(
        0.8, 1.2, strong.size
    )
    damping = 2 * rng.uniform(0.5, 0.7) * np.sqrt(stiffness * 1.3 * drive.rotor_inertia)
    return Bench(arm, (stiffness, damping), noise_level, error)


def rich_episodes(bench: Bench, rng: np.random.Generator) -> list[Episode]:
    """Draws a multisine run twice, two other kinds once, and a fourth kind to be held out."""
    others = [str(kind) for kind in rng.permutation([kind for kind in RICH if kind != "multisine"])]
    model = rigid_model(bench.arm.believed, bench.arm.side)
    first, second, third, fourth = (
        rich_motion(RICH[kind], SECONDS, model, bench.arm.drive, rng) for kind in ("multisine", *others[:3])
    )
    return [
        Episode(first, None, False),
        Episode(first, 0, False),
        Episode(second, None, False),
        Episode(third, None, False),
        Episode(fourth, None, True),
    ]


def task_episodes(bench: Bench, rng: np.random.Generator) -> list[Episode]:
    """Draws what a working robot leaves: reaches, one of them repeated, one held out."""
    model = rigid_model(bench.arm.believed, bench.arm.side)
    kinds = ("reaching", "point_to_point", "reaching", "point_to_point")
    motions = [rich_motion(RICH[kind], SECONDS, model, bench.arm.drive, rng) for kind in kinds]
    plan = [Episode(motions[0], None, False), Episode(motions[0], 0, False)]
    return [
        *plan,
        Episode(motions[1], None, False),
        Episode(motions[2], None, False),
        Episode(motions[3], None, True),
    ]


def poor_episodes(bench: Bench, shape: PoorShape, joint: int, rng: np.random.Generator) -> list[Episode]:
    """Draws runs in which one joint always moves alike and only the others differ; the last is held out."""
    model = rigid_model(bench.arm.believed, bench.arm.side)
    time = np.arange(round(SECONDS * RATE)) / RATE
    path, centre = shape(time, rng), choose_centre(model, bench.arm.drive, rng)
    first, second, third = (poor_motion(path, joint, centre, model, bench.arm.drive, rng) for _ in range(3))
    plan = [Episode(first, None, False), Episode(first, 0, False)]
    return [*plan, Episode(second, None, False), Episode(third, None, True)]


def on_a_surface(bench: Bench, episodes: Sequence[Episode], rng: np.random.Generator) -> Bench:
    """Puts a floor under the hand, as the task has it, 4 cm above the lowest point of all motions."""
    model = rigid_model(bench.arm.believed, bench.arm.side)
    data, lowest = mujoco.MjData(model), []
    for episode in episodes:
        heights = []
        for q in episode.motion.position[::50]:
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            heights.append(float(data.site_xpos[0, 2]))
        if min(heights) < heights[0] - 0.05:
            lowest.append(min(heights))
    height = (min(lowest) if lowest else -2.0) + 0.04
    starts = [episode.motion.position[0] for episode in episodes]
    for q in starts:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        height = min(height, float(data.site_xpos[0, 2]) - 0.03)
    floor = Surface(height, float(10.0 ** rng.uniform(3.3, 4.3)), 100.0, 0.3)
    return replace(bench, arm=replace(bench.arm, surface=floor, mapped=floor))


def measure(bench: Bench, episodes: Sequence[Episode], seed: int) -> NoiseScale:
    """Returns the noise scale on the first run and one of another kind."""
    distinct = [one.motion for one in episodes if one.repeats is None and not one.held_out][:2]
    return NoiseScale(bench.arm, distinct, bench.gains, bench.noise_level, seed)


def situation(bench: Bench, episodes: Sequence[Episode], joint: int, rng: np.random.Generator) -> Situation:
    """Returns what an effect on a joint may look at when it is drawn."""
    peaks = np.array([one.motion.peak for one in episodes])
    centre = episodes[0].motion.position.mean(axis=0)
    weight = np.max([one.motion.weight for one in episodes], axis=0)
    return Situation(bench.arm, joint, centre, peaks.max(axis=0), peaks.min(axis=0), weight, rng)


def plant_effect(
    draw: Draw, bench: Bench, scale: NoiseScale, episodes: Sequence[Episode], wanted: float,
    rng: np.random.Generator, joint: int | None = None, pure: bool = False,
) -> Planted:  # fmt: skip
    """Draws joint and shape until the effect has the wanted size and shows in every motion; or the best of six draws.

    Args:
        draw: The effect.
        bench: Arm without it.
        scale: Measures sizes.
        episodes: All runs of the case.
        wanted: Net size over noise.
        rng: Of the case.
        joint: That must have it, or None for any.
        pure: Refuses shapes by which a second effect id would be true as well.
    """
    best: tuple[float, Planted] | None = None
    for _ in range(6):
        at = int(rng.integers(len(bench.arm.drive.joints))) if joint is None else joint
        injection = draw(situation(bench, episodes, at, rng))
        if pure and injection.also:
            continue
        amplitude, size = scale.tune(injection, wanted)
        planted = Planted(injection, amplitude, size)
        misses = abs(np.log(max(size.net, 1e-6) / wanted))
        hidden = max(np.log(SHOWN * size.net / max(size.weakest, 1e-6)), 0.0) if size.net > 0 else 0.0
        if best is None or misses + hidden < best[0]:
            best = misses + hidden, planted
        if wanted <= size.net <= 1.5 * wanted and hidden == 0.0:
            return planted
    if best is None:
        return plant_effect(draw, bench, scale, episodes, wanted, rng, joint, pure)
    return best[1]


def plant_map_error(error: MapError, bench: Bench, scale: NoiseScale, rng: np.random.Generator) -> Planted:
    """Draws how the floor differs from the task's, and measures the size of that."""
    if bench.arm.mapped is None:
        raise ValueError("the arm has no floor under it")
    amount = error.draw(bench.arm.mapped, rng)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return arm if arm.mapped is None else replace(arm, surface=error.apply(arm.mapped, a))

    injection = Injection(
        error.effect, (), "contact", amount, amount, apply, lambda a: {"surface0": {error.symbol: a}}
    )
    return Planted(injection, amount, scale.size(lambda arm, episode: apply(arm, amount, episode)))


def equivalents_of(
    one: Planted, bench: Bench, scale: NoiseScale, episodes: Sequence[Episode], rng: np.random.Generator
) -> tuple[str, ...]:
    """Returns the simpler effects that no method could tell from this one at its size, in these logs."""
    injection, found = one.injection, []
    if len(injection.joints) != 1:
        return ()
    joint = bench.arm.drive.joints.index(injection.joints[0])
    for name in SIMPLER.get(injection.effect, ()):
        place = situation(bench, episodes, joint, rng)
        other = draw_at(CATALOGUE[name], ports_beside(injection.port), place)
        if scale.apart(injection, one.amplitude, other)[1] < ALIKE:
            found.append(name)
    return tuple(found)


def draw_at(draw: Draw, ports: Sequence[str], s: Situation) -> Injection:
    """Draws an effect until it sits on the situation's joint alone and at one of some ports."""
    while True:
        found = draw(s)
        if found.port in ports and found.joints == (s.name,):
            return found


def ports_beside(port: str) -> tuple[str, ...]:
    """Returns the ports where another effect acts on the same torque: a delay is timing, a lag the actuator's."""
    return ("timing", "actuator") if port == "timing" else (port, "timing")


def apply_all(bench: Bench, planted: Sequence[Planted], episode: int) -> Arm:
    """Returns the arm of one episode with everything that is wrong."""
    arm = bench.arm
    for one in planted:
        arm = one.injection.apply(arm, one.amplitude, episode)
    return arm


def write_logs(
    folder: Path,
    bench: Bench,
    episodes: Sequence[Episode],
    planted: Sequence[Planted],
    seed: int,
    phases: bool,
) -> dict[str, list[str]]:
    """Simulates and writes every episode; returns names of the logs and of those held out."""
    folder.mkdir(parents=True, exist_ok=True)
    side, mapped = bench.arm.side, bench.arm.mapped
    task = None if mapped is None else task_text(side, hand_of(side), mapped)
    names: dict[str, list[str]] = {"logs": [], "holdout": []}
    for i, episode in enumerate(episodes):
        arm = apply_all(bench, planted, i)
        raw = simulate(arm, episode.motion, *bench.gains, Noise(seed + 1000 + i, bench.noise_level))
        columns = record(raw, arm.drive, arm.faults)
        touching = ["contact" if touch > 0.5 else "free" for touch in columns["touch"]] if phases else None
        repeat = None if episode.repeats is None else f"run_{episode.repeats + 1}"
        path = folder / f"run_{i + 1}.parquet"
        save(path, columns, arm.drive.joints, repeat, touching, task)
        names["holdout" if episode.held_out else "logs"].append(path.name)
    return names
