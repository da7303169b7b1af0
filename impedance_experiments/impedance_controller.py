# SPDX-License-Identifier: BSD-3-Clause
"""How an arm with an impedance controller reacts: net stiffness, inertia by posture, a lost support (thesis ch. 4).

Inertia is drawn as ellipsoids of inertia and of mobility around the hand (thesis 4.4, fig. 4-4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from impedance_experiments.loaded_hand import (
    LARGE_TANK,
    LOST,
    TASK,
    WAY,
    Displaced,
    LostSupport,
    displace,
    one_degree_of_freedom,
    press_and_lose,
    tank_need,
)
from impedance_experiments.task_run import only_arm, patch_of
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.spec.task_reader import read_task
from impedance_modules.superposition.examples import thesis_net_stiffness
from impedance_modules.superposition.operational_inertia import linear_ellipsoid

AXES = ("x", "y", "z")
PRINTED = {"x": (329.59, 371.68), "y": (301.5, 292.82), "z": (79.8, 81.54)}
"""Table 5.3: slopes of both directions [N/m]."""
PRESSES = ("soft-deep", "stiff-shallow")
FRICTION = "dry-friction"
FRICTION_RUNS = ("no dry friction", "with dry friction")
POSTURES = {"elbow-out": 0.04, "elbow-up": 0.04, "arm-stretched": 0.0004}
"""Task -> length that stands for a kilogram in its picture [m/kg]."""
PER_MOBILITY = 0.3
"""Length that stands for 1/kg in all pictures [m.kg]."""
VIEWS = {"from above": (0, 1), "from the right": (0, 2)}
NAMES = "xyz"


def reproduce(settings: Settings) -> Page:
    """Displaces a hand, compares postures, and takes a support away."""
    quick = settings.short
    patches = (None,) if quick else (None, patch_of(TASK, FRICTION))
    runs = []
    for index, patch in enumerate(patches):
        settings.on_progress(0.3 * index, "hand displaced")
        runs.append(displace(patch, 1 if quick else 6, settings.seed))
    settings.on_progress(0.7, "support lost")
    lost = [press_and_lose(name, LARGE_TANK, settings.seed) for name in PRESSES]
    if not quick:
        lost += [press_and_lose(name, None, settings.seed) for name in PRESSES]
    hands = {name: hand_inertia(name) for name in POSTURES}
    first = runs[0].found[0]
    return Page(
        summary=_summary(lost),
        comparisons=(*_stiffness_rows(runs), *_press_rows(lost)),
        tables=(_slopes(runs), mass_table(hands), _presses(lost)),
        plots=(_drawn_lines(runs), ellipsoid_plot(hands), _drawn_losses(lost[:2])),
        differences=_differences(runs, lost),
        facts={
            "slope_error": first.out.slope / float(runs[0].stiffness[first.axis, first.axis]) - 1.0,
            "energy_ratio": lost[0].energy / lost[1].energy,
            "force": lost[0].force,
            "speed_soft": lost[0].speed,
            "speed_stiff": lost[1].speed,
            **{f"anisotropy_{name}": hand.anisotropy for name, hand in hands.items()},
        },
    )


def _summary(lost: list[LostSupport]) -> str:
    return (
        f"**Net stiffness.** The hand of the thesis's eq. 5.1 is pushed slowly by {100.0 * WAY:g} cm along each axis "
        f"and let back (task `{TASK}`), with the moments that keep it from turning; force over way is fitted by a "
        "line, as in Table 5.3, without and with dry friction in the joints "
        f"(`--effects {FRICTION}.yaml`).\n\n"
        "**Inertia by posture.** The same palm with the elbow out and up, and an arm stretched almost straight "
        "(fig. 4-4).\n\n"
        f"**Soft and deep, stiff and shallow.** Two springs press with {lost[0].force:.1f} and {lost[1].force:.1f} N; "
        "then the support is gone (fig. 4-8). The hand moves as the one-degree-of-freedom example of 4.1 (page "
        "one-joint), as long as it has not gone far."
    )


def _differences(runs: list[Displaced], lost: list[LostSupport]) -> str:
    return f"{_about_stiffness(runs)}\n\n{_about_tank(lost)}\n\n{_about_one_degree(lost)}"


def _about_stiffness(runs: list[Displaced]) -> str:
    task, _ = read_task(TASK)
    fast, slow = (chosen(push.rise for push in task.pushes) for chosen in (min, max))
    printed = thesis_net_stiffness().at_hand
    off = (
        []
        if printed is None
        else [abs(v / printed[i, i] - 1.0) for i, n in enumerate(AXES) for v in PRINTED[n]]
    )
    held = [item.back.slope / item.out.slope for item in runs[-1].found]
    rubbed = f" (up to {max(held):.2g} times the way out)" if len(runs) > 1 else ""
    return (
        "**Net stiffness.** The thesis's 5.1 uses another wrench than the joint springs carry (page stiffness-matrix); "
        "K_net here is with relaxed joint springs, which a displacement confirms. Its wrist stands at the stop of w0 "
        "in the printed posture; here it is turned over, with the same palm. Three joints have next to no spring of "
        f"their own and follow the hand as slowly as their dampers let them, so a push grows over {fast:g} s, along "
        f"the weak axis over {slow:g} s. What is left between the ways out and back is viscous, what is left between + "
        f"and - is the posture that changes: {100.0 * WAY:g} cm against the weak axis bend the arm, and K_net belongs "
        f"to the start. Dry friction holds the hand back when the push goes: the way back is steep{rubbed} until the "
        "joints move again. The thesis moved the hand by hand, at no stated speed; its own slopes lie "
        f"{_percents(off)} from its eq. 5.1. Friction's size is assumed."
    )


def _about_tank(lost: list[LostSupport]) -> str:
    first = {run.task: run.speed for run in lost[: len(PRESSES)]}
    apart = [abs(run.speed / first[run.task] - 1.0) for run in lost[len(PRESSES) :]]
    alike = (
        f"With the task's own tank the largest speed after the loss is that with one of {LARGE_TANK:g} J to within "
        f"{100.0 * max(apart):.2g} %: the energy for loading the spring came out of the tank before, and a passive "
        "spring may release what it holds. "
        if apart
        else ""
    )
    needs = " and ".join(f"{tank_need(name):.1f} J ({name})" for name in PRESSES)
    return (
        f"**The tank.** {alike}The tank limits how far the spring can be loaded: a tank below the need that `check` "
        f"prints, {needs}, is refused. Schindlbeck's tank, which brakes a force axis that accelerates without contact, "
        "does not act on a spring."
    )


def _about_one_degree(lost: list[LostSupport]) -> str:
    over = [-float(one_degree_of_freedom(run)[2].min()) / run.speed - 1.0 for run in lost[: len(PRESSES)]]
    return (
        "**One degree of freedom.** Joint springs, the turning of the hand and the robot's late speeds are not in eq. "
        f"4.8; its peak speed is {_percents(over)} higher than the plant's."
    )


def _percents(shares: Sequence[float]) -> str:
    return f"{100.0 * min(shares):.0f} to {100.0 * max(shares):.0f} %"


def _stiffness_rows(runs: list[Displaced]) -> list[ThesisValue]:
    rows, loaded = [], thesis_net_stiffness().at_hand
    for run, friction in zip(runs, FRICTION_RUNS, strict=False):
        for item in run.found:
            name, direction = AXES[item.axis], "+" if item.sign > 0 else "-"
            predicted = run.stiffness[item.axis, item.axis]
            printed = PRINTED[name][0 if item.sign > 0 else 1]
            old = "" if loaded is None else f"; the thesis's own eq. 5.1 {loaded[item.axis, item.axis]:.1f}"
            rows.append(
                ThesisValue(
                    f"slope along {direction}{name}, {friction}",
                    printed,
                    round(item.out.slope, 1),
                    "N/m",
                    f"K_net at the start is {predicted:.1f}{old}; the posture changes on the way",
                    f"way back {item.back.slope:.1f}",
                )
            )
    return rows


def _press_rows(lost: list[LostSupport]) -> list[ThesisValue]:
    soft, stiff = lost[:2]
    ratio = round(soft.energy / stiff.energy, 3)
    faster = round(soft.speed / stiff.speed, 3)
    return [
        ThesisValue(
            "energy of the soft, deep spring over the stiff one's",
            2.0,
            ratio,
            "",
            "the same force, twice the way",
        ),
        ThesisValue(
            "speed after the loss, soft over stiff", "larger", faster, "", "root of 2 without any damping"
        ),
    ]


def _slopes(runs: list[Displaced]) -> ResultTable:
    rows: list[list[Cell]] = []
    for run, friction in zip(runs, ("none", "dry"), strict=False):
        for item in run.found:
            lines = (item.out.slope, item.out.intercept, item.back.slope, item.back.intercept)
            way = ("+" if item.sign > 0 else "-") + AXES[item.axis]
            rows.append([way, friction, *(round(v, 2) for v in lines), round(np.degrees(item.turned), 1)])
    columns = (
        "push",
        "friction",
        "out [N/m]",
        "intercept [N]",
        "back [N/m]",
        "intercept [N]",
        "turned [deg]",
    )
    return ResultTable("Force over way: slope and intercept, out and back", columns, rows)


def _presses(lost: list[LostSupport]) -> ResultTable:
    rows: list[list[Cell]] = []
    for run in lost:
        _, _, speeds = one_degree_of_freedom(run)
        numbers = (run.tank, run.force, run.stretch, run.energy, run.speed, -float(speeds.min()))
        rows.append([run.task, *(round(v, 3) for v in numbers), run.trace.ending])
    columns = (
        "task",
        "tank [J]",
        "force [N]",
        "deflection [m]",
        "energy [J]",
        "speed [m/s]",
        "eq. 4.8 [m/s]",
        "ending",
    )
    return ResultTable("Pressing, and the largest speed after the support is gone", columns, rows)


def _drawn_lines(runs: list[Displaced]) -> Plot:
    figure, columns = panels((7.0, 3.0), 1, 3, sharex=True, sharey=True)
    for axis, axes in enumerate(columns):
        for run, colour, label in zip(runs, ("C0", "C1"), ("no dry friction", "dry friction"), strict=False):
            own = np.argmax(np.abs(run.trace.push[:, :3]) / [14.0, 12.0, 4.0], axis=1) == axis
            own &= np.any(run.trace.push != 0.0, axis=1)
            axes.plot(
                1e3 * run.trace.place[own, axis],
                run.trace.push[own, axis],
                ".",
                ms=2,
                color=colour,
                label=label,
            )
        way = np.array([-WAY, WAY])
        axes.plot(1e3 * way, runs[0].stiffness[axis, axis] * way, "k--", linewidth=0.8, label="K_net")
        axes.set(xlabel=f"{AXES[axis]} [mm]")
        axes.grid(alpha=0.3)
    columns[0].set_ylabel("force [N]")
    figure.legend(*columns[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return Plot("stiffness", "Force over way of a displaced hand (as fig. 5-2)", figure)


def _drawn_losses(lost: list[LostSupport]) -> Plot:
    figure, (force, energy, speed) = panels((7.0, 3.0), 1, 3)
    for index, run in enumerate(lost):
        way = np.linspace(0.0, 1.2 * run.stretch, 50)
        stiffness = run.force / run.stretch
        force.plot(100 * way, stiffness * way, color=f"C{index}", label=run.task)
        force.plot(100 * run.stretch, run.force, "o", color=f"C{index}")
        energy.plot(100 * way, 0.5 * stiffness * way**2, color=f"C{index}")
        energy.plot(100 * run.stretch, run.energy, "o", color=f"C{index}")
        after = (run.trace.time > LOST - 0.1) & (run.trace.time < LOST + 1.0)
        speed.plot(run.trace.time[after] - LOST, -run.trace.twist[after, 2], color=f"C{index}")
        _, times, speeds = one_degree_of_freedom(run)
        speed.plot(times - LOST, -speeds, "--", color=f"C{index}", linewidth=0.8)
    force.set(xlabel="deflection [cm]", ylabel="force [N]")
    energy.set(xlabel="deflection [cm]", ylabel="energy [J]")
    speed.set(xlabel="since the loss [s]", ylabel="downward speed [m/s]", title="dashed: eq. 4.8")
    force.legend(fontsize=8)
    return Plot(
        "press", "Force and energy of both springs (fig. 4-8), and the hand once its support is gone", figure
    )


@dataclass(frozen=True)
class HandInertia:
    """A hand in one posture.

    Attributes:
        mobility: (3, 3) Y_v = J_v (M + I_r)^-1 J_v^T, world axes [1/kg].
        joints: (k, 3) where the arm's links begin, the hand last [m].
    """

    mobility: Array
    joints: Array

    @property
    def masses(self) -> Array:
        """(3,) principal apparent masses, heaviest first [kg]: one over the mobility's eigenvalues."""
        return 1.0 / linear_ellipsoid(self.mobility).half_axes

    @property
    def anisotropy(self) -> float:
        """Heaviest over lightest."""
        return float(self.masses[0] / self.masses[-1])


def hand_inertia(task: str) -> HandInertia:
    """Takes a task's start posture."""
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
    arm, model, posture = only_arm(assembly), assembly.model, assembly.modules.posture
    moved = posture.copy()
    moved[model.limbs[arm].joints] += 0.1
    poses = [(model.pose(posture, frame), model.pose(moved, frame)) for frame in model.frames]
    links = [old.translation for old, new in poses if not np.allclose(old.rotation, new.rotation)]
    return HandInertia(analyse_task(assembly, None).arms[arm].mobility[:3, :3], np.array(links))


def mass_table(found: Mapping[str, HandInertia]) -> ResultTable:
    """Tabulates apparent masses along the axes and along the principal directions."""
    rows: list[list[Cell]] = []
    for name, hand in found.items():
        along = 1.0 / np.diag(hand.mobility)
        mobile = 1.0 / hand.masses
        rows.append([name, *map(float, (*along, *hand.masses, hand.anisotropy, mobile[0], mobile[-1]))])
    columns = (
        "posture", "along x [kg]", "along y [kg]", "along z [kg]", "heaviest [kg]", "middle [kg]", "lightest [kg]",
        "heaviest over lightest", "least mobility [1/kg]", "most mobility [1/kg]",
    )  # fmt: skip
    return ResultTable("Apparent mass of the hand, free to turn, reflected inertia included", columns, rows)


def ellipsoid_plot(found: Mapping[str, HandInertia]) -> Plot:
    """Draws the arms from above and from the side, with the outlines of both ellipsoids around the hand."""
    figure, rows = panels((7.2, 5.8), len(VIEWS), len(found), squeeze=False)
    for column, (name, hand) in enumerate(found.items()):
        for axes, (view, plane) in zip(rows[:, column], VIEWS.items(), strict=True):
            _draw_ellipsoids(axes, hand, plane, POSTURES[name])
            title = f"{name},\n{view}"
            axes.set(title=title, xlabel=f"{NAMES[plane[0]]} [m]", ylabel=f"{NAMES[plane[1]]} [m]")
            axes.set_aspect("equal")
        rows[0, column].legend(loc="lower center", bbox_to_anchor=(0.5, 1.3), frameon=False, fontsize=7)
    scales = [POSTURES[name] for name in found]
    for row in rows:
        for scale in set(scales):
            _share_limits([axes for axes, own in zip(row, scales, strict=True) if own == scale])
    caption = (
        "Arms and, around the hand, outlines of the inertia ellipsoid (half axes: apparent masses; note the scale, a "
        "hundredth for the stretched arm) and of the mobility ellipsoid, which stays small and finite near the "
        "singular posture (fig. 4-4)"
    )
    return Plot("inertia", caption, figure)


def _share_limits(alike: Sequence[Axes]) -> None:
    """Gives axes that are compared the same limits: a square around all that is drawn in them."""
    boxes = [axes.dataLim for axes in alike]
    low = np.min([box.min for box in boxes], axis=0)
    high = np.max([box.max for box in boxes], axis=0)
    middle, half = 0.5 * (low + high), 0.55 * float(np.max(high - low))
    for axes in alike:
        axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))


def _draw_ellipsoids(axes: Axes, hand: HandInertia, plane: tuple[int, int], per_kilogram: float) -> None:
    picked = list(plane)
    axes.plot(*hand.joints[:, picked].T, "o-", color="0.5", ms=3)
    centre = hand.joints[-1, picked]
    inertia: Array = np.asarray(per_kilogram * np.linalg.inv(hand.mobility))
    mobility: Array = np.asarray(PER_MOBILITY * hand.mobility)
    shown = (
        (inertia, "C3", f"inertia, 0.1 m = {0.1 / per_kilogram:g} kg"),
        (mobility, "C0", f"mobility, 0.1 m = {0.1 / PER_MOBILITY:.2g} /kg"),
    )
    for matrix, colour, label in shown:
        axes.plot(*np.add(centre[:, None], outline(matrix, plane)), color=colour, label=label)


def outline(matrix: Array, plane: tuple[int, int]) -> Array:
    """Gives the shadow (2, 200) on a plane of the ellipsoid A u, |u| = 1, of a symmetric (3, 3) matrix A."""
    picked = matrix[list(plane)]
    values, vectors = np.linalg.eigh(picked @ picked.T)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ np.vstack([np.cos(turn), np.sin(turn)]))
