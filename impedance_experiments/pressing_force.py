# SPDX-License-Identifier: BSD-3-Clause
"""From where could the 25 N of the thesis's first task come? (5.1.3): readings, a sweep by statics, and the plant.

The thesis gives K_end (table 5.2), K_joints (table 5.1), an equilibrium 24 cm below the table and 25 N, but neither
the posture at which the joint springs rest nor how the hand touches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_experiments.press_on_plant import PlantPress, press_all
from impedance_experiments.press_statics import PressingArm
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.superposition import examples
from impedance_modules.tools.spring_tuning import self_motion

POSTURE_OF, TASK = "net-stiffness", "slide-flat"
"""Tasks with the posture of eq. 5.1, at which the hand is taken to be on the table, and with the slide's springs."""
PRINTED_FORCE, PRINTED_DEPTH = 25.0, 0.24
"""Of 5.1.3: force on the surface [N] and depth of the equilibrium below the table [m]."""
ABOVE = 0.025
"""Height over the table of a posture above it [m]; the joint springs of ``slide-flat`` rest nearly so."""
ALONG_X, ALONG_Y = (0.4, 0.5, 0.6, 0.7), (-0.5, -0.3, -0.1, 0.1)
"""Places over the table [m]."""
REACHED = 1e-3
"""A place is within reach where the hand comes so near to it [m]."""
OUTER = (0.1, 0.9)
NEAR = 0.1
"""A reading agrees that is off by less than this share."""
END, NET = "spring at the hand alone, K_z D", "net stiffness of eq. 4.15, K_zz D"
AT_TABLE = "joint springs rest at the table"
OVER_TABLE = "joint springs rest above the table"
DEEP_POINT = "joint springs rest with the hand deep, it touches with a point"
DEEP_FLAT = "joint springs rest with the hand deep, it lies flat"
READINGS = (END, AT_TABLE, OVER_TABLE, DEEP_POINT, DEEP_FLAT, NET)


@dataclass(frozen=True)
class Place:
    """One posture on the table, and what each reading gives there.

    Attributes:
        hand: (3,) [m].
        along: Distance along the self-motion from the posture nearest to that of eq. 5.1 [rad].
        forces: Reading -> force [N].
        rests: Reading -> (k,) where the joint springs rest [rad].
        short: How far the deepest posture falls short of the equilibrium of the spring at the hand [m].
    """

    hand: Array
    along: float
    forces: dict[str, float]
    rests: dict[str, Array]
    short: float


def reproduce(settings: Settings) -> Page:
    """Computes all readings at the posture of eq. 5.1 and over the table, and presses on the plant."""
    task, posed = _task(TASK), _task(POSTURE_OF)
    arm, q = _pressing_arm(task), posed.modules.posture[posed.modules.arms[0].limb.joints]
    table = float(arm.look(q)[0].translation[2])
    own = _read(arm, q, 0.0, table)
    settings.on_progress(0.05, "other places on the table")
    swept = tuple(_sweep(arm, posed, q, table, settings))
    settings.on_progress(0.7, "on the plant")
    plant = press_all(own.rests, table, PRINTED_DEPTH, settings)
    return Page(
        summary=_summary(own, swept, plant),
        comparisons=tuple(_comparisons(own, swept, plant)),
        tables=(_table_of_readings(own, swept), _table_of_plant(own, plant)),
        plots=(_picture(own, swept, plant),),
        differences=_differences(own, swept, plant),
        facts={
            **{f"statics, {reading}": force for reading, force in own.forces.items()},
            **{f"plant, {run.name}": run.force for run in plant},
            "places": float(len(swept)),
        },
    )


def _task(name: str) -> Assembly:
    return assemble(name, effects=None, rate=None, scale=1.0, arm=None)


def _pressing_arm(task: Assembly) -> PressingArm:
    module = task.modules.arms[0]
    if module.bias is None:
        raise TypeError(f"task '{task.task.name}' has no joint springs")
    spring = np.asarray(module.springs[0].stiffness)[:3, :3]
    return PressingArm(task.model, module.limb, np.asarray(module.bias.stiffness), spring)


def _read(arm: PressingArm, q: Array, along: float, table: float) -> Place:
    """Gives the force of every reading with the hand on the table at q (k,) [rad]."""
    pose, _ = arm.look(q)
    goal = pose.translation - np.array([0.0, 0.0, PRINTED_DEPTH])
    deep = arm.posture_at(goal, q, pose.rotation)
    above = arm.posture_at(pose.translation + np.array([0.0, 0.0, ABOVE]), q, pose.rotation)
    rests = {AT_TABLE: q, OVER_TABLE: above, DEEP_POINT: deep, DEEP_FLAT: deep}
    forces = {END: float(arm.end_stiffness[2, 2]) * PRINTED_DEPTH}
    for reading, rest in rests.items():
        forces[reading] = arm.press(rest, goal, table, q, flat=reading == DEEP_FLAT).force
    forces[NET] = arm.net_force(q, PRINTED_DEPTH)
    short = float(np.linalg.norm(arm.look(deep)[0].translation - goal))
    return Place(pose.translation, along, forces, rests, short)


def _sweep(arm: PressingArm, posed: Assembly, q: Array, table: float, settings: Settings) -> Iterator[Place]:
    """Goes over the table, and at every place that the hand reaches along the arm's self-motion."""
    limb, rotation = posed.modules.arms[0].limb, arm.look(q)[0].rotation
    places = [(x, y) for x in ALONG_X for y in ALONG_Y][:: settings.choose(8, 1, 1)]
    for number, place in enumerate(places):
        settings.on_progress(0.05 + 0.65 * number / len(places), "other places on the table")
        goal = np.array([*place, table])
        found = arm.posture_at(goal, q, rotation)
        if np.linalg.norm(arm.look(found)[0].translation - goal) > REACHED:
            continue
        whole = posed.modules.posture.copy()
        whole[limb.joints] = found
        for posture in self_motion(posed.model, limb, whole, settings.choose(2, 4, 8)):
            yield _read(arm, posture.q[limb.joints], posture.along, table)


def _values(swept: tuple[Place, ...], reading: str) -> Array:
    return np.array([place.forces[reading] for place in swept])


def _summary(own: Place, swept: tuple[Place, ...], plant: tuple[PlantPress, ...]) -> str:
    low, middle, high = np.quantile(_values(swept, DEEP_FLAT), (OUTER[0], 0.5, OUTER[1]))
    agreeing = [run for run in plant if _agrees(run.force)]
    on_plant = "; ".join(f"{run.name}: {run.force:.1f} N" for run in plant)
    return (
        f"The thesis's first task was designed to press with {PRINTED_FORCE:g} N, the equilibrium "
        f"{100.0 * PRINTED_DEPTH:.0f} cm below the table. With {_stiffness():g} N/m at the hand that is "
        f"{own.forces[END]:.0f} N, and joint springs that rest where the hand touches add nothing: "
        f"{own.forces[AT_TABLE]:.1f} N. The rest is in the joint springs. The net stiffness of eq. 4.15 at the "
        f"posture of eq. 5.1 times {100.0 * PRINTED_DEPTH:.0f} cm is {own.forces[NET]:.1f} N "
        f"({_chain_force():.1f} N with the thesis's own chain); that product assumes that the joint springs, too, rest "
        "with the hand that deep, and that the hand does not turn. Statics without any linearisation, joint springs "
        "at rest with the hand as deep as the arm reaches and the hand flat on the table, gives "
        f"{own.forces[DEEP_FLAT]:.1f} N there, and {middle:.1f} N in the middle of "
        f"{len(swept)} postures at other places on the table ({low:.1f} to {high:.1f} N from {100 * OUTER[0]:g} % to "
        f"{100 * OUTER[1]:g} % of them). On the plant: {on_plant}. Within {100 * NEAR:g} % of the thesis are "
        f"{len(agreeing)} of these {len(plant)}."
    )


def _chain_force() -> float:
    """Gives K_zz of eq. 4.15 times the depth, on the thesis's own chain [N]."""
    net = examples.relaxed_net_stiffness().at_hand
    return float("nan") if net is None else float(net[2, 2]) * PRINTED_DEPTH


def _agrees(force: float) -> bool:
    return abs(force / PRINTED_FORCE - 1.0) <= NEAR


def _stiffness() -> float:
    return float(_task(TASK).modules.arms[0].springs[0].stiffness[2, 2])


def _reason(reading: str, own: Place) -> str:
    return {
        END: "the spring alone, nothing at the joints",
        AT_TABLE: "joint springs are relaxed on the table and give nothing against a force straight down",
        OVER_TABLE: f"{1e3 * ABOVE:.0f} mm above it, as in `{TASK}`: they pull the hand back up",
        DEEP_POINT: "the hand turns about its point until its joint springs give way",
        DEEP_FLAT: f"the table keeps the hand from turning; the arm falls {100 * own.short:.0f} cm short of that depth",
        NET: "linear: both springs rest equally deep, the hand does not turn",
    }[reading]


def _comparisons(
    own: Place, swept: tuple[Place, ...], plant: tuple[PlantPress, ...]
) -> Iterator[ThesisValue]:
    for reading in READINGS:
        low, high = np.quantile(_values(swept, reading), OUTER)
        yield ThesisValue(
            f"force on the table, by statics: {reading}",
            PRINTED_FORCE,
            own.forces[reading],
            "N",
            _reason(reading, own),
            f"{low:.1f} to {high:.1f} over the table",
        )
    for run in plant:
        yield ThesisValue(
            f"force on the table, on the plant: {run.name}",
            PRINTED_FORCE,
            run.force,
            "N",
            "the last second of a hand at rest, at the posture of eq. 5.1",
            f"{run.least:.1f} to {run.most:.1f} in that second",
        )
    yield ThesisValue(
        "K_zz of eq. 4.15, the thesis's own chain, times the depth",
        PRINTED_FORCE,
        _chain_force(),
        "N",
        "the chain of chapter 2 at the posture of eq. 5.1; our links are those of the robot's description",
    )
    stiffness, loaded = _stiffness(), examples.thesis_net_stiffness().at_hand
    depth = float(examples.ACTUAL[2] - examples.DESIRED[2])
    if loaded is not None:
        for name, value in (("K_z", stiffness), ("K_zz of eq. 5.1", float(loaded[2, 2]))):
            for deep in (PRINTED_DEPTH, depth):
                yield ThesisValue(
                    f"{name} times {100.0 * deep:.0f} cm",
                    PRINTED_FORCE,
                    value * deep,
                    "N",
                    "depth as in 5.1.3"
                    if deep == PRINTED_DEPTH
                    else "depth of x_d below x_act in Appendix C",
                )


def _table_of_readings(own: Place, swept: tuple[Place, ...]) -> ResultTable:
    rows: list[list[Cell]] = []
    for reading in READINGS:
        values = _values(swept, reading)
        low, middle, high = np.quantile(values, (OUTER[0], 0.5, OUTER[1]))
        near = sum(_agrees(value) for value in values)
        rows.append(
            [
                reading,
                f"{own.forces[reading]:.1f}",
                f"{middle:.1f} ({low:.1f} to {high:.1f})",
                f"{values.min():.1f}",
                f"{values.max():.1f}" if values.max() < 100.0 * PRINTED_FORCE else "without bound",
                f"{near} of {len(values)}",
            ]
        )
    return ResultTable(
        f"Force on the table at rest [N], D = {100.0 * PRINTED_DEPTH:.0f} cm: at the posture of eq. 5.1, and at "
        f"{len(swept)} postures over the table (places every {100.0 * float(np.diff(ALONG_X)[0]):.0f} and "
        f"{100.0 * float(np.diff(ALONG_Y)[0]):.0f} cm, elbows along the self-motion); median ({100 * OUTER[0]:g} % to "
        f"{100 * OUTER[1]:g} %)",
        (
            "reading",
            "eq. 5.1",
            "over the table",
            "least",
            "largest",
            f"within {100 * NEAR:g} % of the thesis",
        ),
        rows,
    )


def _table_of_plant(own: Place, plant: tuple[PlantPress, ...]) -> ResultTable:
    rows: list[list[Cell]] = [
        [run.name, f"{own.forces[run.reading]:.1f}", f"{run.force:.1f}", f"{1e3 * run.moved:.0f}"]
        for run in plant
    ]
    return ResultTable(
        "On the plant, at the posture of eq. 5.1; where the hand lies flat, a rotational spring at the "
        "hand stands for the table's hold",
        ("case", "statics [N]", "plant [N]", "moved along the table [mm]"),
        rows,
    )


def _picture(own: Place, swept: tuple[Place, ...], plant: tuple[PlantPress, ...]) -> Plot:
    """Draws the force of every reading over the table, and the plant's force over time."""
    figure, (spread, course) = panels((7.0, 3.4), 1, 2, width_ratios=(1.25, 1.0))
    names = {
        END: "hand spring alone",
        AT_TABLE: "rest at the table",
        OVER_TABLE: "rest above it",
        DEEP_POINT: "rest deep, point",
        DEEP_FLAT: "rest deep, flat",
        NET: "net stiffness",
    }
    random = np.random.default_rng(0)
    for row, reading in enumerate(reversed(READINGS)):
        values = _values(swept, reading)
        beside = row + random.uniform(-0.25, 0.25, values.size)
        spread.plot(values, beside, ".", color="C0", ms=3, alpha=0.5)
        spread.plot(own.forces[reading], row, "D", color="C3", ms=5)
    spread.axvline(PRINTED_FORCE, color="C6", lw=0.8, ls="--")
    spread.set_yticks(range(len(READINGS)), [names[reading] for reading in reversed(READINGS)])
    spread.set(xlabel="force on the table [N]", xlim=(0.0, 45.0))
    for number, run in enumerate(plant):
        course.plot(run.time, run.forces, color=f"C{number}", label=run.name)
    course.axhline(PRINTED_FORCE, color="C6", lw=0.8, ls="--")
    course.set(xlabel="time [s]", ylabel="force on the table [N]", ylim=(0.0, 1.25 * PRINTED_FORCE))
    for axes in (spread, course):
        axes.grid(alpha=0.3)
    figure.legend(*course.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    caption = (
        "Left: force of every reading, by statics, at postures over the table (points) and at that of eq. 5.1 "
        "(diamonds; net stiffnesses of nearly stretched arms lie further right); right: on the plant. Dashed: the "
        "thesis."
    )
    return Plot("forces", caption, figure)


def _differences(own: Place, swept: tuple[Place, ...], plant: tuple[PlantPress, ...]) -> str:
    rubbing = [run for run in plant if run.reading == DEEP_FLAT]
    spread = max(run.force for run in rubbing) - min(run.force for run in rubbing)
    short = np.array([place.short for place in swept])
    return "\n".join(
        (
            "- **What the thesis leaves open** is where the joint springs rest. Eq. 4.14 and 4.15 multiply one "
            "displacement of the hand with the stiffness of both kinds of springs, and section 4.3 speaks of joint "
            "equilibria q_d that correspond to x_d; that is the reading that comes near its force, though the thesis "
            "does not say that it was meant. Eq. 5.1 itself, with the wrench of the hand's spring in it, does not "
            "give it.",
            f"- **The deep posture** does not quite exist: the arm ends {100.0 * short.min():.0f} to "
            f"{100.0 * short.max():.0f} cm short of {100.0 * PRINTED_DEPTH:.0f} cm below the table, nearly stretched. "
            "The joint springs are taken to rest at the posture that comes nearest with the hand's orientation kept.",
            f"- **The touch**: our hand is a point, on which it can turn ({own.forces[DEEP_POINT]:.0f} N without "
            "friction, more where friction holds the point); a flange that lies flat cannot "
            f"({own.forces[DEEP_FLAT]:.0f} N). The thesis does not say how its hand touched. "
            f"`{TASK}` and the tasks made from it keep joint springs that rest above the table and a hand that touches "
            "with a point, so they press with half the force of the thesis.",
            f"- **Friction and speed** matter less: between no friction and much, and between leaning quickly and "
            f"slowly, the force of the flat hand changes by {spread:.1f} N.",
        )
    )
