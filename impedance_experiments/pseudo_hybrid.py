# SPDX-License-Identifier: BSD-3-Clause
r"""Two ways to press on a surface: a force that does not know its place, and a spring that ends below it (thesis 4.7).

    F = f_0 + K (x_0 - x) - B x'        (4.35), here with K = 0
    F = K (x_0 - x) - B x'              (4.37), f_k = K x_0 (4.38)

Both press with the same force on a table where the map has it. Then the table is elsewhere, by \delta, and the force of
the spring should err by K \delta; and the hand is pushed up harder than it presses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.task_run import only_arm, watch_task
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.pushes import push_wrench
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.robot.state import RobotState

TASKS = {"force (4.35)": "press-by-force", "spring (4.37)": "press-by-spring"}
OFFSETS = (-0.03, -0.015, 0.0, 0.015, 0.03)
"""Height of the table over that of the map [m]."""
Z = 2
STEADY = 0.5
"""Over which a pressing force is averaged before the push, and how long before its end a speed is taken [s]."""


@dataclass(frozen=True)
class Press:
    """One run, N samples.

    Attributes:
        time: (N,) [s].
        height: (N,) of the hand over the table [m].
        force: (N,) of the table on the hand, upwards [N].
        start, end: When the push begins to grow, and to fall [s].
        ending: How the run ended.
    """

    time: Array
    height: Array
    force: Array
    start: float
    end: float
    ending: str

    @property
    def pressed(self) -> float:
        """Mean force before the push [N]."""
        before = (self.time >= self.start - STEADY) & (self.time < self.start)
        return float(np.mean(self.force[before]))

    @property
    def lifted(self) -> float:
        """How far the push has moved the hand when it begins to fall [m]."""
        return float(self._at(self.end) - self._at(self.start))

    @property
    def speed(self) -> float:
        """Of the hand over the last part of the full push [m/s]."""
        return float((self._at(self.end) - self._at(self.end - STEADY)) / STEADY)

    def _at(self, time: float) -> float:
        return float(np.interp(time, self.time, self.height))


def reproduce(settings: Settings) -> Page:
    """Presses in both ways on tables at several heights, and pushes both hands up."""
    offsets = (0.0, OFFSETS[-1]) if settings.short else OFFSETS
    found: dict[str, dict[float, Press]] = {}
    for number, (way, task) in enumerate(TASKS.items()):
        found[way] = {}
        for step, offset in enumerate(offsets):
            settings.on_progress(0.5 * (number + step / len(offsets)), f"{way}, table {1e3 * offset:+g} mm")
            found[way][offset] = press(_task(task), offset, settings.seed)
    stiffness = {way: _along_z(_task(task)) for way, task in TASKS.items()}
    return Page(
        summary=_summary(found),
        comparisons=_comparisons(found, stiffness),
        tables=(_table(found, stiffness),),
        plots=(_picture(found, stiffness),),
        differences=_differences(found, stiffness),
        facts=_facts(found, stiffness),
    )


def _task(name: str) -> Assembly:
    return assemble(name, effects=None, rate=None, scale=1.0, arm=None)


def press(assembly: Assembly, offset: float, seed: int) -> Press:
    """Runs a task with its table higher by ``offset`` [m]."""
    table = assembly.task.environment[0]
    height = (0.0 if table.height is None else table.height) + offset
    moved = replace(assembly.task, environment=(replace(table, height=height),))
    hand = assembly.model.limbs[only_arm(assembly)].hand
    rows: list[tuple[float, float, float]] = []

    def observe(_: RobotState, plant: Plant, __: Supervisor) -> None:
        place = plant.pose(hand).translation[Z] - height
        rows.append((plant.time, float(place), float(plant.contact_wrench(hand)[Z])))

    supervisor = watch_task(replace(assembly, task=moved), observe, seed=seed)
    push = assembly.task.pushes[0]
    ending = "" if supervisor.ending is None else supervisor.ending.value
    time, place, force = np.array(rows).T
    end = push.start + push.rise + push.hold
    return Press(time, place, force, push.start, end, f"{ending} {supervisor.reason}".strip())


def _along_z(assembly: Assembly) -> tuple[float, float]:
    """Gives the spring's declared stiffness along z, and the hand's net one at the start posture [N/m]."""
    spring = assembly.modules.arms[0].springs[0]
    net = analyse_task(assembly, None).arms[only_arm(assembly)].stiffness
    if net is None:
        raise ValueError(f"task '{assembly.task.name}' has no net stiffness at its start")
    return float(spring.stiffness[Z, Z]), float(net[Z, Z])


def _slope(runs: dict[float, Press]) -> float:
    """Fits how the force grows with the height of the table [N/m]."""
    return float(np.polyfit(list(runs), [run.pressed for run in runs.values()], 1)[0])


def _push_size() -> float:
    push = _task(next(iter(TASKS.values()))).task.pushes[0]
    return float(push_wrench((push,), push.target, push.start + push.rise)[Z])


def _summary(found: dict[str, dict[float, Press]]) -> str:
    force, spring = found.values()
    endings = "; ".join(
        f"{way}: {100.0 * runs[0.0].lifted:.1f} cm, {100.0 * runs[0.0].speed:.1f} cm/s at its end"
        for way, runs in found.items()
    )
    return (
        f"A palm presses on a table with {force[0.0].pressed:.1f} N by a force that does not depend on its place (task "
        f"`{TASKS['force (4.35)']}`), and with {spring[0.0].pressed:.1f} N by a spring whose rest lies below the "
        f"surface (`{TASKS['spring (4.37)']}`), with the same springs at the joints. Then the table stands elsewhere "
        "than the map says, and the force is measured again; and the hand is pushed up with "
        f"{_push_size():.0f} N, more than it presses with. The push moves the hand on the mapped table by: {endings}."
    )


def _comparisons(
    found: dict[str, dict[float, Press]], stiffness: dict[str, tuple[float, float]]
) -> tuple[ThesisValue, ...]:
    rows = []
    printed = {"force (4.35)": 0.0, "spring (4.37)": stiffness["spring (4.37)"][0]}
    for way, runs in found.items():
        own, net = stiffness[way]
        reason = f"K_net is {net:.1f}: the joint springs add {net - own:.1f} to K_x, which the thesis leaves out here"
        label = f"{way}: error of the force over the map's error (the thesis: K_x)"
        rows.append(ThesisValue(label, printed[way], round(_slope(runs), 1), "N/m", reason))
    for way, runs in found.items():
        expected = (_push_size() - runs[0.0].pressed) / stiffness[way][1]
        rows.append(
            ThesisValue(
                f"{way}: pushed up with {_push_size():.0f} N, the hand gives way by",
                None,
                round(100.0 * runs[0.0].lifted, 2),
                "cm",
                f"at rest it would be {100.0 * expected:.1f} by K_net",
                f"still {100.0 * runs[0.0].speed:.2f} cm/s when the push ends",
            )
        )
    return tuple(rows)


def _table(found: dict[str, dict[float, Press]], stiffness: dict[str, tuple[float, float]]) -> ResultTable:
    rows: list[list[Cell]] = []
    for way, runs in found.items():
        for offset, run in runs.items():
            predicted = runs[0.0].pressed + stiffness[way][1] * offset
            numbers = (1e3 * offset, run.pressed, predicted, 1e3 * run.lifted, 1e3 * run.speed)
            rows.append([way, *(round(value, 2) for value in numbers), run.ending])
    columns = (
        "pressed by", "table higher by [mm]", "force [N]", "predicted by K_net [N]", "pushed up by [mm]",
        "speed then [mm/s]", "ending",
    )  # fmt: skip
    return ResultTable("Pressing on tables that are not where the map has them, and the push", columns, rows)


def _differences(found: dict[str, dict[float, Press]], stiffness: dict[str, tuple[float, float]]) -> str:
    force, spring = TASKS
    return (
        "The thesis compares the two in words. That the force of (4.35) does not depend on the place holds for the law "
        f"at the hand; the joint springs beside it leave {stiffness[force][1]:.1f} N/m. In return nothing but they "
        f"holds the hand when it is pushed harder than it presses: it goes on at {100.0 * found[force][0.0].speed:.1f} "
        f"cm/s, where the spring of (4.37) has slowed to {100.0 * found[spring][0.0].speed:.2f} cm/s. The damping of "
        "the force axis is that of its limit of speed; the spring's is designed from the hand's inertia."
    )


def _facts(
    found: dict[str, dict[float, Press]], stiffness: dict[str, tuple[float, float]]
) -> dict[str, float]:
    facts: dict[str, float] = {}
    for way, name in zip(TASKS, ("force", "spring"), strict=True):
        runs = found[way]
        facts |= {
            f"{name}, slope": _slope(runs),
            f"{name}, net": stiffness[way][1],
            f"{name}, declared": stiffness[way][0],
            f"{name}, pressed": runs[0.0].pressed,
            f"{name}, lifted": runs[0.0].lifted,
            f"{name}, speed": runs[0.0].speed,
            f"{name}, done": float(all(run.ending == "done" for run in runs.values())),
        }
    return facts


def _picture(found: dict[str, dict[float, Press]], stiffness: dict[str, tuple[float, float]]) -> Plot:
    """Draws the force over the table's height, and the hand's height while it is pushed."""
    figure, (force, height) = panels((7.0, 3.2), 1, 2)
    for colour, (way, runs) in zip(("C3", "C0"), found.items(), strict=True):
        offsets = np.array(list(runs))
        force.plot(1e3 * offsets, [run.pressed for run in runs.values()], "o", color=colour, label=way)
        force.plot(
            1e3 * offsets, runs[0.0].pressed + stiffness[way][1] * offsets, "--", color=colour, linewidth=0.8
        )
        run = runs[0.0]
        after = run.time > run.start - STEADY
        height.plot(run.time[after], 1e3 * run.height[after], color=colour, label=way)
    height.axvspan(run.start, run.end, color="0.9")
    force.set(xlabel="table higher than the map [mm]", ylabel="force on the table [N]", ylim=(0.0, None))
    height.set(xlabel="time [s], pushed in the grey part", ylabel="hand over the table [mm]")
    figure.legend(*height.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    for axes in (force, height):
        axes.grid(alpha=0.3)
    return Plot(
        "push", "Force on tables at other heights (dashed: by K_net), and the push on the mapped one", figure
    )
