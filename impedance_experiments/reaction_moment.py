# SPDX-License-Identifier: BSD-3-Clause
r"""What a blow along the normal makes of a hand, with one arm and with two (thesis 4.4 and 4.5).

A hand that is stopped along the normal n without turning needs the impulse \Lambda (n, 0): beside the force along n a
moment, the reaction moment, wherever \Lambda couples n with the turn. Struck by a force along n alone, it turns. The
arms' inertias are predicted by superposition and measured on the plant by three blows, v = \Lambda^-1 \int F dt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.planar_arms import NAMES, PLANE, PRINTED
from impedance_experiments.task_run import PushTrace, first_pushes, only_arm, trace_pushed
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.plant.ground_truth import OBJECT
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.superposition.object_impedance import superpose

TASKS = {"one arm": "planar-one-arm", "two arms": "planar-arms"}
MATRICES = {"one arm": "eq. 4.28, right arm", "two arms": "eq. 4.30, both"}
BOX_TASKS = {"one arm": "one-arm-inertia", "two arms": "two-arms-inertia"}
"""Baxter's arms on one box."""
BOX_END = 0.3
"""After a blow on the box a run goes on for so long [s]."""
NORMAL, TURN = 1, 2
"""Of the plane's coordinates: the blow's direction y, and the turn."""
LEVER = 0.2
"""Moment of the blow about the upright axis, for each newton of the others [m]."""
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Struck:
    """One arm or two.

    Attributes:
        predicted, measured: (3, 3) inertia in the plane [kg, kg.m, kg.m^2].
        trace: Of the blow along the normal.
    """

    predicted: Array
    measured: Array
    trace: PushTrace

    @property
    def turn(self) -> Array:
        """(N,) angle of the struck body [rad]."""
        return np.asarray(self.trace.place[:, PLANE[TURN]])


def moment_over_force(inertia: Array) -> float:
    """Gives the reaction moment for each newton along the normal, if nothing may turn [m]."""
    return float(inertia[TURN, NORMAL] / inertia[NORMAL, NORMAL])


def turn_over_way(inertia: Array) -> float:
    """Gives how fast a body turns for each m/s along the normal when a force along it strikes alone [rad/m]."""
    mobility = np.linalg.inv(inertia)
    return float(mobility[TURN, NORMAL] / mobility[NORMAL, NORMAL])


def reproduce(settings: Settings) -> Page:
    """Strikes one planar arm and two, and predicts the same for Baxter's arms on a box."""
    found = {}
    for number, (name, task) in enumerate(TASKS.items()):
        settings.on_progress(0.4 * number, name)
        found[name] = strike_all_ways(
            assemble(task, effects=None, rate=None, scale=1.0, arm=None), settings.seed
        )
    settings.on_progress(0.9, "both arms on a box")
    box, turns = box_moments(), box_turns(settings.seed)
    one, two = found.values()
    return Page(
        summary=_summary(found),
        comparisons=(*_rows(found), *_box_rows(box), *_turn_rows(turns)),
        tables=(*(_matrix(name, part) for name, part in found.items()), _box_table(box)),
        plots=(_picture(found, box),),
        differences=_differences(box),
        facts={
            "one, predicted": moment_over_force(one.predicted),
            "one, measured": moment_over_force(one.measured),
            "two, measured": moment_over_force(two.measured),
            "one, turn": turn_over_way(one.measured),
            "two, turn": turn_over_way(two.measured),
            "worst inertia": max(float(np.abs(s.measured - s.predicted).max()) for s in (one, two)),
            **{f"box, {name}": float(np.linalg.norm(moments)) for name, moments in box.items()},
            **{f"box turn, {name}": float(np.hypot(turn[0][0], turn[0][2])) for name, turn in turns.items()},
            **{
                f"box turn predicted, {name}": float(np.hypot(turn[1][0], turn[1][2]))
                for name, turn in turns.items()
            },
        },
    )


def strike_all_ways(assembly: Assembly, seed: int) -> Struck:
    """Strikes what the task strikes along x, along y and about the upright axis, each in a run of its own."""
    analysis = analyse_task(assembly, None)
    body = only_arm(assembly) if analysis.object is None else OBJECT
    frame = analysis.arms[body] if analysis.object is None else analysis.object
    size = max(abs(part) for part in assembly.task.pushes[0].wrench)
    columns, traces = [], []
    for coordinate in PLANE:
        trace = trace_pushed(_struck_along(assembly, coordinate, size), body, seed=seed, noise=True)
        columns.append(_answer(assembly, trace) / _impulse(trace)[coordinate])
        traces.append(trace)
    mobility = np.array(columns).T
    return Struck(
        predicted=np.asarray(np.linalg.inv(frame.mobility[np.ix_(PLANE, PLANE)])),
        measured=np.asarray(np.linalg.inv(mobility)),
        trace=traces[NORMAL],
    )


def _struck_along(assembly: Assembly, coordinate: int, size: float) -> Assembly:
    strength = size if coordinate < PLANE[TURN] else LEVER * size
    x, y, z, rx, ry, rz = (strength if k == coordinate else 0.0 for k in range(6))
    push = replace(assembly.task.pushes[0], wrench=(x, y, z, rx, ry, rz))
    return replace(assembly, task=replace(assembly.task, pushes=(push,)))


def _impulse(trace: PushTrace) -> Array:
    """Integrates the push, (6,) [N.s], [N.m.s]."""
    return np.asarray(np.trapezoid(trace.push, trace.time, axis=0))


def _answer(assembly: Assembly, trace: PushTrace) -> Array:
    """Takes the velocity in the plane just after the blow, (3,) [m/s], [rad/s]."""
    push = assembly.task.pushes[0]
    after = push.start + push.rise + push.hold + push.fall
    return np.asarray(trace.twist[int(np.searchsorted(trace.time, after))][list(PLANE)])


def box_moments() -> dict[str, Array]:
    """Gives, for Baxter's arms on a box, the moments (3, 3) for each newton along x, y and z (columns) [m]."""
    both = BOX_TASKS["two arms"]
    found = analyse_task(assemble(both, effects=None, rate=None, scale=1.0, arm=None), None).sum
    if found is None:
        raise ValueError(f"task '{both}' holds nothing")
    hands = list(found.hands.values())
    moments = {}
    for name, held in {"one arm": hands[:1], "two arms": hands}.items():
        inertia = superpose(held, found.own).inertia.inertia
        if inertia is None:
            raise ValueError(f"task '{both}': an arm is singular at its posture")
        moments[name] = np.asarray(inertia[3:, :3] / np.diag(inertia)[:3])
    return moments


def box_turns(seed: int) -> dict[str, tuple[Array, Array]]:
    """Strikes Baxter's box along x; gives its turn (3,) for each metre along x, measured and predicted [rad/m]."""
    found = {}
    for name, task in BOX_TASKS.items():
        assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
        analysed = analyse_task(assembly, None).object
        if analysed is None:
            raise ValueError(f"task '{task}' holds nothing")
        once = first_pushes(assembly, 1, BOX_END)
        trace = trace_pushed(once, OBJECT, seed=seed, noise=True)
        push = once.task.pushes[0]
        before, after = (
            trace.twist[int(np.searchsorted(trace.time, time))]
            for time in (push.start, push.start + push.rise + push.hold + push.fall)
        )
        moved = after - before
        mobility = analysed.mobility
        found[name] = np.asarray(moved[3:] / moved[0]), np.asarray(mobility[3:, 0] / mobility[0, 0])
    return found


def _turn_rows(turns: dict[str, tuple[Array, Array]]) -> list[ThesisValue]:
    return [
        ThesisValue(
            f"Baxter's box struck along x, {name}: turn about x and z for each metre, measured",
            None,
            round(float(np.hypot(measured[0], measured[2])), 3),
            "rad/m",
            f"predicted {np.hypot(predicted[0], predicted[2]):.3f}; motors' friction acts during the blow",
        )
        for name, (measured, predicted) in turns.items()
    ]


def _summary(found: dict[str, Struck]) -> str:
    one, two = found.values()
    return (
        "One planar arm of the thesis's fig. 4-5, and two that hold one pin (fig. 4-7), are struck on the plant along "
        "y, "
        "the normal of a surface, through the hand (tasks "
        f"{', '.join(f'`{task}`' for task in TASKS.values())}). One arm's hand turns by "
        f"{turn_over_way(one.measured):.2f} "
        f"rad for each metre along the normal; the pin in two hands by {turn_over_way(two.measured):.3f}. Stopped "
        "without turning, one hand needs a moment of "
        f"{moment_over_force(one.measured):.3f} N.m for each newton; two, {moment_over_force(two.measured):.4f}. Both "
        "inertias are measured by blows along x, along y and about the upright axis, and compared with the sum of the "
        "arms that superposition gives. Then Baxter's own box is struck along x, in one hand and in both."
    )


def _rows(found: dict[str, Struck]) -> list[ThesisValue]:
    rows = []
    for name, part in found.items():
        printed = np.array(PRINTED[MATRICES[name]])
        predicted = moment_over_force(part.predicted)
        rows.append(
            ThesisValue(
                f"reaction moment over normal force, {name}, measured",
                round(moment_over_force(printed), 4) + 0.0,
                round(moment_over_force(part.measured), 4) + 0.0,
                "m",
                f"of {MATRICES[name]}; predicted {predicted:.4f}; a blow takes time, in which the arm moves",
            )
        )
        rows.append(
            ThesisValue(
                f"turn for each metre along the normal, struck by a force alone, {name}, measured",
                round(turn_over_way(printed), 4) + 0.0,
                round(turn_over_way(part.measured), 4) + 0.0,
                "rad/m",
                f"of {MATRICES[name]}, whose digits are rounded; predicted {turn_over_way(part.predicted):.4f}",
            )
        )
    return rows


def _box_rows(box: dict[str, Array]) -> list[ThesisValue]:
    return [
        ThesisValue(
            f"Baxter on a box, struck along {axis}: reaction moment over force, two arms over one",
            None,
            round(float(np.linalg.norm(box["two arms"][:, i]) / np.linalg.norm(box["one arm"][:, i])), 3),
            "1",
            f"{np.linalg.norm(box['one arm'][:, i]):.3f} m with one arm, predicted by the sums",
        )
        for i, axis in enumerate(AXES)
    ]


def _matrix(name: str, part: Struck) -> ResultTable:
    rows: list[list[Cell]] = [
        [NAMES[i], *(round(float(v), 3) + 0.0 for v in (*part.predicted[i], *part.measured[i]))]
        for i in range(3)
    ]
    columns = ("", *(f"{axis}, predicted" for axis in NAMES), *(f"{axis}, measured" for axis in NAMES))
    return ResultTable(f"Inertia of {name} in the plane [kg, kg.m, kg.m^2]", columns, rows)


def _box_table(box: dict[str, Array]) -> ResultTable:
    rows: list[list[Cell]] = [
        [name, axis, *(round(float(value), 4) + 0.0 for value in moments[:, i])]
        for name, moments in box.items()
        for i, axis in enumerate(AXES)
    ]
    columns = ("held by", "struck along", "moment about x", "about y", "about z")
    return ResultTable("Baxter's arms on a box: moment for each newton [m], predicted", columns, rows)


def _differences(box: dict[str, Array]) -> str:
    left = np.abs(box["two arms"][[0, 2], 0]).max()
    kept = abs(box["two arms"][1, 0])
    return (
        "The thesis draws the planar arms and strikes nothing; it says that the coupling of y is eliminated. It is, "
        "for "
        "a mirror plane through the normal. Baxter's arms mirror each other in the plane of x and z: struck along x, "
        f"the moments about x and z come down to {left:.4f} m, not to nothing, because both arms carry the same, "
        f"unmirrored link inertias; the moment about y, {kept:.3f} m, lies in the mirror plane's own motion and stays."
    )


def _picture(found: dict[str, Struck], box: dict[str, Array]) -> Plot:
    """Draws how far the struck bodies turn, and Baxter's moments."""
    figure, (turn, bars) = panels((7.0, 3.2), 1, 2)
    for colour, (name, part) in zip(("C3", "C0"), found.items(), strict=True):
        turn.plot(part.trace.time, np.degrees(part.turn), color=colour, label=name)
    turn.set(xlabel="time [s]", ylabel="turn after a blow [deg]")
    turn.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    turn.grid(alpha=0.3)
    place = np.arange(3)
    for shift, colour, (name, moments) in zip((-0.2, 0.2), ("C3", "C0"), box.items(), strict=True):
        bars.bar(place + shift, np.linalg.norm(moments, axis=0), 0.4, color=colour, label=f"Baxter, {name}")
    bars.set_xticks(place, [f"along {axis}" for axis in AXES])
    bars.set(xlabel="struck", ylabel="moment for each newton [m]")
    bars.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return Plot("moments", "Planar arms struck on the plant; Baxter's arms on a box, predicted", figure)
