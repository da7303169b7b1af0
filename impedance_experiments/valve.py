# SPDX-License-Identifier: BSD-3-Clause
"""Can a valve be operated with acceptable torque? Judged by joint efforts and positions alone (thesis 1.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_experiments.valve_reaction import Reaction, reactions
from impedance_experiments.valve_runs import ANGLE, STUCK, TASKS, ValveTest, examine, operable, yields
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.analysis import analyse_task

ACCEPTABLE = 1.5
"""Torque with which a valve may be operated, in this experiment [N.m]."""
RANGE = (0.2, 3.0)
"""Of the frictions of valves that turn [N.m]."""
NEAR = 0.05
"""Part of ACCEPTABLE within which valves are hard to judge."""
CONFIDENCE = 0.95
"""With which the error rate is bounded where no error was seen."""
TORQUE = 1.0
"""Of the push that measures the stiffness about the axis [N.m]."""


@dataclass(frozen=True)
class Hands:
    """Everything found with one hand, or with two.

    Attributes:
        trained: Valves that the rule was set on.
        bound: The rule's torque [N.m].
        judged: Valves that it was not set on.
        stuck: A valve that does not turn.
        stiffness: About the axis: every arm's part, their sum, and what the plant shows [N.m/rad].
        reaction: With the object free, and on its hinge.
    """

    trained: Sequence[ValveTest]
    bound: float
    judged: Sequence[ValveTest]
    stuck: ValveTest
    stiffness: tuple[Mapping[str, float], float, float]
    reaction: tuple[Reaction, Reaction]

    @property
    def all(self) -> list[ValveTest]:
        """Every valve that was tested."""
        return [*self.trained, *self.judged, self.stuck]

    @property
    def wrong(self) -> tuple[int, int]:
        """How many acceptable valves were refused, and how many others accepted; the stuck one counts."""
        refused = sum(t.friction <= ACCEPTABLE and not operable(t, self.bound) for t in self.judged)
        accepted = sum(
            t.friction > ACCEPTABLE and operable(t, self.bound) for t in [*self.judged, self.stuck]
        )
        return refused, accepted


def reproduce(settings: Settings) -> Page:
    """Tests valves of several frictions with one hand and with two."""
    found: dict[str, Hands] = {}
    for number, (hands, task) in enumerate(TASKS.items()):
        settings.on_progress(number / len(TASKS), hands)
        found[hands] = _tested(task, settings, number)
    return Page(
        summary=_summary(found),
        comparisons=_comparisons(found),
        tables=(_valves(found), _reactions(found)),
        plots=(_courses(found), _judgements(found)),
        differences=_differences(found),
        facts=_facts(found),
    )


def _tested(task: str, settings: Settings, number: int) -> Hands:
    source = np.random.default_rng([settings.seed, number])
    seeds = (settings.seed + k for k in range(1000 * number, 1000 * number + 1000))
    count, others = settings.choose(2, 6, 12), settings.choose(1, 9, 60)
    frictions = np.linspace(RANGE[0], RANGE[1], count)
    near = ACCEPTABLE * (1.0 + NEAR * source.uniform(-1.0, 1.0, others // 2))
    drawn = np.concatenate([source.uniform(*RANGE, others - others // 2), near])
    trained = [examine(task, float(f), next(seeds), settings.work) for f in frictions]
    settings.on_progress((number + 0.3) / len(TASKS), f"{task}: valves to judge")
    judged = [examine(task, float(f), next(seeds), settings.work) for f in drawn]
    settings.on_progress((number + 0.8) / len(TASKS), f"{task}: stiffness")
    impedance = analyse_task(assemble(task, effects=None, rate=None, scale=1.0, arm=None), None).hinge
    if impedance is None or impedance.stiffness.sum is None:
        raise ValueError(f"task '{task}' has no stiffness about a hinge")
    shares = {limb: part for limb, part in impedance.stiffness.arms.items() if part is not None}
    shown = yields(task, TORQUE, next(seeds), settings.work, float(settings.choose(4, 8, 16)))
    return Hands(
        trained=trained,
        bound=_bound(trained),
        judged=judged,
        stuck=examine(task, STUCK, next(seeds), settings.work),
        stiffness=(shares, impedance.stiffness.sum, shown),
        reaction=reactions(task),
    )


def _bound(trained: Sequence[ValveTest]) -> float:
    """Sets the rule: the acceptable torque, shifted by what the measurement says too much on average [N.m]."""
    return ACCEPTABLE + float(np.mean([test.needed - test.friction for test in trained]))


def _errors(tests: Sequence[ValveTest]) -> np.ndarray:
    """Gives measured less true torque that each valve needed [N.m]."""
    return np.array([test.needed - test.true_needed for test in tests])


def _summary(found: Mapping[str, Hands]) -> str:
    one, two = found["one arm"], found["two arms"]
    hands = " and ".join(f"`{task}` ({name})" for name, task in TASKS.items())
    return (
        "The thesis's third task is to find a nominally known feature, a valve or a lever, and to "
        '"test its function, '
        'i.e. whether it can be operated with acceptable force/torque". Here the feature is an object on a hinge: '
        f"{hands}. The hands turn the hinge's target by {ANGLE:g} rad to one side and to the other and so bound by "
        "their springs what they can do to it. From joint positions and efforts alone, as a recording has them, follow "
        "the angle and the torque about the axis; the plant knows the true ones.\n\n"
        f"**The torque.** Over {len(one.all) + len(two.all)} valves the torque that a valve needed is measured with an "
        f"error of {1e3 * float(np.sqrt(np.mean(_errors([*one.all, *two.all]) ** 2))):.0f} mN.m (root mean square). A "
        f"stuck valve is one whose angle does not follow: it moved by at most "
        f"{1e3 * max(one.stuck.moved, two.stuck.moved):.1f} mrad under {one.stuck.needed:.1f} N.m of one hand and "
        f"{two.stuck.needed:.1f} N.m of two.\n\n"
        f"**The rule.** A valve can be operated if it turned and needed at most {ACCEPTABLE:g} N.m plus the mean "
        f"error on the {len(one.trained)} valves that the rule was set on: {one.bound:.3f} N.m with one hand, "
        f"{two.bound:.3f} N.m with two. "
        f"{_verdict(found)}\n\n"
        "**Two arms.** About the axis the hands' stiffnesses add like everything else: "
        f"{_added(two)}. The plant, pushed about the axis, shows {two.stiffness[2]:.2f} N.m/rad.\n\n"
        '**The reaction.** A fully constrained task "will produce very different reaction dynamics": on the hinge the '
        f"object has one motion left of six. A torque about the axis meets {_ratio(one):.0f} times the inertia that it "
        f"meets with the lever free in the hand, as the hand must follow the arc, and {_ratio(two):.1f} times with the "
        f"wheel between two hands. How much stiffer the hands could be made before their loop is unstable: "
        f"{_loops(found)}."
    )


def _verdict(found: Mapping[str, Hands]) -> str:
    """Says how often the rule was wrong on valves that it was not set on."""
    parts = []
    for name, hands in found.items():
        refused, accepted = hands.wrong
        parts.append(
            f"with {name} {refused} acceptable valves were refused and {accepted} others accepted, of"
            f" {len(hands.judged) + 1}"
        )
    return (
        f"On valves that it was not set on, {_near(list(found.values()))} of them within {100 * NEAR:g} % of the "
        f"acceptable torque, {'; '.join(parts)}.{_ceiling(found)}"
    )


def _ceiling(found: Mapping[str, Hands]) -> str:
    """Says what error rate so many valves without an error leave possible; nothing where there was one."""
    if any(sum(hands.wrong) for hands in found.values()):
        return ""
    count = sum(len(hands.judged) + 1 for hands in found.values())
    rate = 1.0 - (1.0 - CONFIDENCE) ** (1.0 / count)
    return (
        f" With {100 * CONFIDENCE:g} % confidence the rule is wrong on fewer than {100 * rate:.0f} % of such valves; "
        "what it has to tell apart are torques that differ by more than its error."
    )


def _near(hands: Sequence[Hands]) -> int:
    """Counts the valves to judge whose friction is close to the acceptable torque."""
    return sum(abs(t.friction - ACCEPTABLE) <= NEAR * ACCEPTABLE for h in hands for t in h.judged)


def _added(hands: Hands) -> str:
    shares, total, _ = hands.stiffness
    return f"{' + '.join(f'{part:.2f}' for part in shares.values())} = {total:.2f} N.m/rad"


def _ratio(hands: Hands) -> float:
    free, hinged = hands.reaction
    return hinged.inertia / free.inertia


def _loops(found: Mapping[str, Hands]) -> str:
    parts = []
    for name, hands in found.items():
        free, hinged = hands.reaction
        parts.append(
            f"with {name} {free.margin:.1f} times with the object free and {hinged.margin:.1f} times on the hinge"
        )
    return ", ".join(parts)


def _comparisons(found: Mapping[str, Hands]) -> tuple[ThesisValue, ...]:
    rows = []
    for name, hands in found.items():
        errors, (refused, accepted) = 1e3 * _errors(hands.all), hands.wrong
        _, total, shown = hands.stiffness
        rows += [
            ThesisValue(
                f"error of the torque a valve needs, {name}",
                None,
                round(float(np.sqrt(np.mean(errors**2))), 1),
                "mN.m",
                "joint efforts and positions against the plant's truth",
                f"{errors.min():.0f} to {errors.max():.0f} over {len(errors)} valves",
            ),
            ThesisValue(
                f"valves judged wrongly, {name}",
                None,
                refused + accepted,
                f"of {len(hands.judged) + 1}",
                f"not those it was set on; {_near([hands])} of them within {100 * NEAR:g} % of the acceptable torque",
                f"{refused} refused, {accepted} accepted",
            ),
            ThesisValue(
                f"stiffness about the axis, plant over sum of the modules, {name}",
                None,
                round(shown / total, 4),
                "1",
                f"law: 1; pushed with {TORQUE:g} N.m",
            ),
        ]
    return tuple(rows)


def _valves(found: Mapping[str, Hands]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            name,
            "stuck" if test.friction >= STUCK else test.friction,
            test.true_needed,
            test.needed,
            1e3 * test.error,
            1e3 * test.moved,
            test.bearing,
            "yes" if operable(test, hands.bound) else "no",
        ]
        for name, hands in found.items()
        for test in sorted(hands.all, key=lambda t: t.friction)
    ]
    columns = (
        "hands",
        "friction [N.m]",
        "needed, true [N.m]",
        "needed, measured [N.m]",
        "error of the course, rms [mN.m]",
        "moved [mrad]",
        "bearing, at most [N]",
        "judged operable",
    )
    return ResultTable("Every valve that was tested", columns, rows)


def _reactions(found: Mapping[str, Hands]) -> ResultTable:
    rows: list[list[Cell]] = []
    for name, hands in found.items():
        for how, reaction in zip(("free in the hands", "on its hinge"), hands.reaction, strict=True):
            loop = reaction.loop
            rows.append(
                [
                    f"{name}, {how}",
                    reaction.motions,
                    reaction.inertia,
                    reaction.stiffness,
                    loop.frequency,
                    loop.damping_ratio,
                    reaction.margin,
                ]
            )
    columns = (
        "object",
        "motions",
        "inertia about the axis [kg.m^2]",
        "stiffness about the axis [N.m/rad]",
        "least damped mode [Hz]",
        "its ratio",
        "stable up to, times the stiffness",
    )
    return ResultTable("What a torque about the axis meets, and the loop of the hands", columns, rows)


def _courses(found: Mapping[str, Hands]) -> Plot:
    figure, axes = panels((10.0, 4.0), 1, 2, sharey=True)
    for place, (name, hands) in zip(axes, found.items(), strict=True):
        for color, test in enumerate([*hands.trained, hands.stuck]):
            label = "stuck" if test.friction >= STUCK else f"{test.friction:.2f} N.m"
            place.plot(1e3 * test.angle, test.torque, color=f"C{color}", linewidth=1.0, label=label)
            place.plot(1e3 * test.angle, test.true_torque, color="k", linewidth=0.6, linestyle=":")
        place.axhline(ACCEPTABLE, color="0.7", linewidth=1)
        place.axhline(-ACCEPTABLE, color="0.7", linewidth=1)
        place.set(title=name, xlabel="measured angle [mrad]")
        place.grid(alpha=0.3)
    axes[0].set_ylabel("torque about the axis [N.m]")
    axes[1].legend(fontsize=7, title="friction", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return Plot(
        "courses", "Torque over angle as measured; true torque dotted; acceptable torque grey", figure
    )


def _judgements(found: Mapping[str, Hands]) -> Plot:
    figure, axes = panels((6.0, 4.0))
    for color, (name, hands) in enumerate(found.items()):
        turned = [test for test in hands.judged if test.turned]
        axes.plot(
            [t.friction for t in turned],
            1e3 * np.array([t.needed - t.friction for t in turned]),
            "o",
            color=f"C{color}",
            label=name,
        )
    axes.axvline(ACCEPTABLE, color="0.7", linewidth=1)
    axes.axhline(0.0, color="0.7", linewidth=1)
    axes.set(xlabel="friction of the valve [N.m]", ylabel="measured less true [mN.m]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return Plot("judgements", "Error of the torque on valves that the rule was not set on", figure)


def _differences(found: Mapping[str, Hands]) -> str:
    tests = [test for hands in found.values() for test in hands.all]
    return (
        "The thesis names this task and prints no numbers for it. Its feature would be found by touch first; here the "
        "hinge's axis is known, as the task file says it, and the hands hold the object from the start. The axis is "
        "vertical, so that no weight acts about it. The bearing carries whatever of the hands' forces does not turn "
        f"the object, up to {max(test.bearing for test in tests):.0f} N here: a target that follows the arc "
        "(`equilibrium: {hinge: {angle: ...}}`) loads it with little else than the way the springs are displaced "
        "along the lever. Weight or a return spring would shift both ways alike and drop out of the difference."
    )


def _facts(found: Mapping[str, Hands]) -> dict[str, float]:
    facts: dict[str, float] = {}
    for name, hands in found.items():
        mark = name.split()[0]
        facts |= {
            f"{mark}_error": float(np.max(np.abs(_errors(hands.all)))),
            f"{mark}_wrong": float(sum(hands.wrong)),
            f"{mark}_stiffness": hands.stiffness[2] / hands.stiffness[1],
            f"{mark}_stuck": float(hands.stuck.turned),
            f"{mark}_margin_free": hands.reaction[0].margin,
            f"{mark}_margin_hinged": hands.reaction[1].margin,
        }
    return facts
