# SPDX-License-Identifier: BSD-3-Clause
r"""A redundant arm led round a closed path: what its self-motion does (thesis 4.3, fig. 4-3).

Three ways to lead it. A hand spring alone, and a hand spring beside joint springs, both on the plant; and joint
velocities by the Jacobian's pseudo-inverse, as in velocity control, without any dynamics:

    dq = J^+ dx,        dx from where the hand is to the path's next point

J^+ gives the smallest joint motion, whose integral depends on the path (Klein and Huang 1983): the hand comes back,
the joints do not. A joint spring has one rest for each place of the hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.task_run import displacement, frames_of, only_arm, watch_task
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.state import RobotState

TASKS = {"hand spring alone": "self-motion", "hand spring and joint springs": "self-motion-held"}
PSEUDO_INVERSE = "pseudo-inverse"
LARGE_TANK = 60.0
"""A tank that lasts for all loops [J]; the task's own lasts for one."""
STEPS = 400
"""Steps of the pseudo-inverse for one side of the path."""


@dataclass(frozen=True)
class Loops:
    """One way to lead the arm, n loops.

    Attributes:
        q: (n + 1, k) the arm's joints at the start and after every loop [rad].
        hand: (n + 1,) distance of the hand from where it was after the first loop [m].
        links: (n + 1, m, 3) where the links begin, the hand last [m].
        ending: How the run ended.
    """

    q: Array
    hand: Array
    links: Array
    ending: str

    @property
    def drift(self) -> Array:
        """(n + 1,) distance of the joints from where they were after the first loop [rad]."""
        return np.asarray(np.linalg.norm(self.q - self.q[1], axis=1))

    @property
    def each(self) -> float:
        """Distance of the joints after the last loop from before it [rad]."""
        return float(np.linalg.norm(self.q[-1] - self.q[-2]))


def reproduce(settings: Settings) -> Page:
    """Leads the arm round the path in three ways."""
    count = settings.choose(3, 12, 12)
    found: dict[str, Loops] = {}
    for number, (way, task) in enumerate(TASKS.items()):
        settings.on_progress(0.4 * number, way)
        found[way] = on_plant(
            assemble(task, effects=None, rate=None, scale=1.0, arm=None), count, settings.seed
        )
    settings.on_progress(0.8, PSEUDO_INVERSE)
    first = assemble(TASKS["hand spring alone"], effects=None, rate=None, scale=1.0, arm=None)
    found[PSEUDO_INVERSE] = by_pseudo_inverse(first, count, STEPS)
    finer = by_pseudo_inverse(first, 1, 2 * STEPS)
    coarse = float(np.linalg.norm(finer.q[1] - found[PSEUDO_INVERSE].q[1]))
    return Page(
        summary=_summary(first, found),
        comparisons=_comparisons(found, coarse),
        tables=(_table(found),),
        plots=(_picture(found),),
        differences=_differences(found),
        facts={
            **{f"drift, {way}": float(loops.drift[-1]) for way, loops in found.items()},
            **{f"hand, {way}": float(loops.hand[1:].max()) for way, loops in found.items()},
            "step error": coarse,
        },
    )


def on_plant(assembly: Assembly, count: int, seed: int) -> Loops:
    """Repeats a task's phases on the plant and takes the joints at the end of each repetition."""
    phases = assembly.task.phases
    once = sum(phase.duration for phase in phases)
    repeated = [replace(phase, name=f"{phase.name}-{k}") for k in range(count) for phase in phases]
    tank = replace(assembly.tank, initial=LARGE_TANK, max=2.0 * LARGE_TANK)
    longer = replace(assembly, task=replace(assembly.task, phases=tuple(repeated)), tank=tank)
    rows: list[Array] = []

    def observe(_: RobotState, plant: Plant, __: Supervisor) -> None:
        if plant.time >= len(rows) * once - 1.5 * assembly.period:
            rows.append(plant.position)

    supervisor = watch_task(longer, observe, seed=seed)
    ending = "" if supervisor.ending is None else supervisor.ending.value
    return _loops(assembly, np.array(rows[: count + 1]), f"{ending} {supervisor.reason}".strip())


def by_pseudo_inverse(assembly: Assembly, count: int, steps: int) -> Loops:
    """Integrates the joint velocities of the pseudo-inverse along the straight sides of the task's path."""
    model, arm = assembly.model, only_arm(assembly)
    limb = model.limbs[arm]
    kinematics = Kinematics(model, (limb.hand,))
    q = assembly.modules.posture.copy()
    pose = model.pose(q, limb.hand)
    rows = [q.copy()]
    for _ in range(count):
        for corner in _corners(assembly, model.pose(assembly.modules.posture, limb.hand)):
            start = pose
            for step in range(1, steps + 1):
                kinematics.update(q, np.zeros_like(q))
                jacobian = kinematics.jacobian_of(limb.hand)[:, limb.joints]
                wanted = start.translation + (corner.translation - start.translation) * step / steps
                ahead = displacement(model.pose(q, limb.hand), Pose(corner.rotation, wanted))
                q[limb.joints] += np.linalg.pinv(jacobian) @ ahead
            pose = corner
        rows.append(q.copy())
    return _loops(assembly, np.array(rows), "integrated")


def _corners(assembly: Assembly, start: Pose) -> list[Pose]:
    """Lists where the path's sides end, the hand never turning."""
    place, corners = start.translation.copy(), []
    for phase in assembly.task.phases:
        for target in phase.equilibrium.values():
            for axis, value in target.items():
                if not isinstance(value, float):
                    raise TypeError(f"task '{assembly.task.name}': its path must go from corner to corner")
                place["xyz".index(axis)] = value
            corners.append(Pose(start.rotation, place.copy()))
    return corners


def _loops(assembly: Assembly, rows: Array, ending: str) -> Loops:
    model, limb = assembly.model, assembly.model.limbs[only_arm(assembly)]
    hands = np.array([model.pose(q, limb.hand).translation for q in rows])
    frames = frames_of(assembly, only_arm(assembly))
    links = np.array([[model.pose(q, frame).translation for frame in frames] for q in rows])
    away = np.linalg.norm(hands - hands[min(1, len(hands) - 1)], axis=1)
    return Loops(rows[:, limb.joints], away, links, ending)


def _summary(assembly: Assembly, found: Mapping[str, Loops]) -> str:
    free, held = TASKS.values()
    corners = _corners(
        assembly, assembly.model.pose(assembly.modules.posture, assembly.model.limbs[only_arm(assembly)].hand)
    )
    places = np.array([corner.translation for corner in corners])
    size = 100.0 * np.ptp(places, axis=0)
    endings = ", ".join(f"{way}: {loops.drift[-1]:.3f} rad" for way, loops in found.items())
    return (
        f"The hand goes {len(found[PSEUDO_INVERSE].q) - 1} times round a rectangle of {size[1]:.0f} by {size[2]:.0f} "
        "cm "
        f"without turning: on the plant with its spring alone (task `{free}`), on the plant with springs at the joints "
        f"beside it (`{held}`), and by the Jacobian's pseudo-inverse, as a velocity control would lead it. Seven "
        "joints "
        "can hold one hand in many ways; how far the joints are from where they were after the first loop, the hand "
        f"back in its place, is what the self-motion has done. After the last loop: {endings}."
    )


def _comparisons(found: Mapping[str, Loops], coarse: float) -> tuple[ThesisValue, ...]:
    printed = {
        "hand spring alone": "unpredictable configurations",
        "hand spring and joint springs": "removed",
        PSEUDO_INVERSE: "drift in the joint space",
    }
    reasons = {
        "hand spring alone": "no spring and hardly a damper acts on the self-motion: what moves it stays",
        "hand spring and joint springs": "one rest for each place of the hand",
        PSEUDO_INVERSE: f"not integrable; half the step changes the first loop by {1e3 * coarse:.2g} mrad",
    }
    rows = []
    for way, loops in found.items():
        spread = f"{loops.each:.2g} in the last loop; hand back to {1e3 * float(loops.hand[1:].max()):.1f} mm"
        label = f"joints' drift over {len(loops.q) - 2} loops, {way}"
        rows.append(
            ThesisValue(label, printed[way], round(float(loops.drift[-1]), 4), "rad", reasons[way], spread)
        )
    return tuple(rows)


def _table(found: Mapping[str, Loops]) -> ResultTable:
    count = len(found[PSEUDO_INVERSE].q)
    rows: list[list[Cell]] = [
        [
            loop,
            *(
                round(float(loops.drift[loop]), 4) if loop < len(loops.q) else None
                for loops in found.values()
            ),
        ]
        for loop in range(1, count)
    ]
    return ResultTable(
        "Distance of the joints from where they were after the first loop [rad]", ("after loop", *found), rows
    )


def _differences(found: Mapping[str, Loops]) -> str:
    alone, held = (float(found[way].drift[-1]) for way in TASKS)
    return (
        "The thesis draws a planar arm and prints no number; here it is Baxter's arm. With the hand spring alone only "
        "the motors' own friction resists the self-motion, so how far it drifts depends on how the hand has moved, not "
        f"on where it is: {alone:.2g} rad, beside {held:.1g} rad with joint springs. The pseudo-inverse knows neither "
        "friction nor inertia; its drift is the geometry's."
    )


def _extent(points: Array) -> tuple[Array, Array]:
    """Gives the least and the largest coordinates of points (m, 2)."""
    return points.min(axis=0), points.max(axis=0)


def _picture(found: Mapping[str, Loops]) -> Plot:
    """Draws the drift over the loops, and the arms after the first and the last loop, seen from the front."""
    figure, axes = panels((7.4, 3.6), 1, 1 + len(found), width_ratios=(2.0, *(1.0 for _ in found)))
    for colour, (way, loops) in zip(("C3", "C0", "C1"), found.items(), strict=True):
        axes[0].plot(range(1, len(loops.q)), loops.drift[1:], "o-", color=colour, label=way, markersize=3)
    axes[0].set(xlabel="loop", ylabel="joints away from the first loop's end [rad]")
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    axes[0].grid(alpha=0.3)
    ends = np.concatenate([loops.links[k][:, 1:] for loops in found.values() for k in (1, -1)])
    margin = 0.3 * float(np.ptp(ends[:, 0]))
    across, upward = (
        (float(low) - margin, float(high) + margin) for low, high in zip(*_extent(ends), strict=True)
    )
    for view, colour, (way, loops) in zip(axes[1:], ("C3", "C0", "C1"), found.items(), strict=True):
        view.plot(*loops.links[1][:, 1:].T, "o-", color="0.6", markersize=3)
        view.plot(*loops.links[-1][:, 1:].T, "o-", color=colour, markersize=3)
        view.set(xlabel="y [m]", xlim=across, ylim=upward)
        view.set_title(way.replace(" and ", "\nand "))
        view.set_aspect("equal")
        view.locator_params(axis="x", nbins=3)
    axes[1].set_ylabel("z [m]")
    caption = (
        "How far the joints are from the first loop's end, and the arm seen from the front, after the first loop "
        "(grey) and after the last (as fig. 4-3)"
    )
    return Plot("loops", caption, figure)
