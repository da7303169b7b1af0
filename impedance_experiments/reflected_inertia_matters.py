# SPDX-License-Identifier: BSD-3-Clause
"""Why reflected inertia matters: apparent mass, and the same impact with and without rotors (thesis 3.3)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from impedance_experiments.apparent_mass import (
    ABSOLUTE,
    RELATIVE,
    TASK,
    Impact,
    Masses,
    against,
    assembled,
    first_contact,
    planar_masses,
)
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels

PRINTED = {"with": (2.574, 1.31), "without": (1.628, 0.7683)}
"""Table 3.1: largest and smallest apparent mass [kg]."""
PRINTED_RATIO = {"largest": 1.58, "smallest": 1.71, "shape factor": 0.92, "forces": 1.6}
"""With over without: of Table 3.1's masses and shape factors, and of the forces of 3.3.1."""
PRINTED_SHAPE = {"with": 1.96, "without": 2.12}
"""Table 3.1: largest over smallest."""
PRINTED_FORCE = {"with": 3.67, "without": 2.34}
"""Of 3.3.1 [N]."""
READINGS = {"joint angles": RELATIVE, "link angles against the ground": ABSOLUTE}
CONTACT_TIME, SPEED = 0.07, 0.1
"""Of the thesis's estimate F = m v / T [s], [m/s]."""
WITH_70_MS, WITHOUT_70_MS = 15000.0, 10500.0
"""Stiffness of the surface, tuned until the hand stays for the thesis's 70 ms, with rotors and without [N/m]."""
TUNED = "(surface tuned)"
SURFACES = (5000.0, WITHOUT_70_MS, WITH_70_MS, 50000.0)
Pair = tuple[Impact, Impact]
NOT_FROM_POSTURE = "the stated posture does not give the printed masses"
MASS = "all seven joints, another posture, chosen by us, and masses, not their square roots"


def reproduce(settings: Settings) -> Page:
    """Computes the masses in all readings, and lets both robots first_contact the same surfaces."""
    masses, strikes = _masses(), _strikes(settings)
    return Page(
        summary=_summary(strikes),
        comparisons=(*_mass_rows(masses), *_impact_rows(strikes)),
        tables=(_mass_table(masses), _step_table(strikes), _impact_table(strikes)),
        plots=(_ellipses(masses), _forces(strikes)),
        differences=_differences(masses, strikes),
        facts=_facts(masses, strikes),
    )


def _differences(masses: dict[str, Masses], strikes: dict[float, Pair]) -> str:
    return f"{_about_table(masses)}\n\n{_about_impact(strikes)}"


def _about_table(masses: dict[str, Masses]) -> str:
    reading = masses["joint angles"]
    off = [
        abs(math.sqrt(mass) / printed - 1.0)
        for robot, pair in PRINTED.items()
        for mass, printed in zip(reading.extremes(robot), pair, strict=True)
    ]
    ratio = reading.extremes("with")[0] / reading.extremes("without")[0]
    return (
        "**Table 3.1** does not follow from the stated posture as the eigenvalues of Lambda, whichever way its angles "
        "are read (the first angle does not matter: it turns the picture). The listing of Appendix A takes the square "
        "root of the eigenvalues before it draws; with joint angles the square roots come near the printed numbers "
        f"({100.0 * min(off):.0f} to {100.0 * max(off):.0f} % away). Then the ratio of the *masses* is the square of "
        f"the printed one, {PRINTED_RATIO['largest'] ** 2:.2f}, and ours is {ratio:.2f}; and the thesis's ratio of "
        f"forces, {PRINTED_RATIO['forces']:g}, which is the ratio of its printed masses and was not measured, would "
        "be the same."
    )


def _about_impact(strikes: dict[float, Pair]) -> str:
    heavy, light = strikes[WITH_70_MS][0], strikes[WITHOUT_70_MS][1]
    steps = _steps(strikes)
    predicted, measured = list(steps.values())[:2]
    return (
        "**The posture of the impact** is another one than that of fig. 3-9. In the task's posture, with all seven "
        f"joints free, the masses with and without rotors stand as {predicted:.2f} to one.\n\n"
        "**F = m v / T** supposes that both arms stop within the same time and that rotor and link are one body. On "
        "the plant the same surface throws the lighter arm back sooner, and the joints' springs let the link meet the "
        "surface before its rotors arrive: the first peak is the links' alone, with rotors or without. What the rotors "
        "add is time and impulse. The mean force at one and the same contact time is where the ratio shows, and there "
        f"{predicted:.2f} becomes {steps['mean forces']:.2f}, in steps (table): during the longer touch of its softer "
        f"surface the light arm's own springs add to the measured mass (the ratio is {measured:.2f}), and the arm with "
        f"rotors leaves with {heavy.left / heavy.speed:.2f} of its speed, because rotors are left swinging against "
        f"links, where the other leaves with {light.left / light.speed:.2f}. The thesis's "
        f"{PRINTED_RATIO['forces']:g} takes rotor and link for one rigid body."
    )


def _masses() -> dict[str, Masses]:
    assembly = assembled(rotors=True)
    arm = next(iter(assembly.task.arms.values()))
    held = set() if arm.joint_bias is None else set(arm.joint_bias.stiffness)
    moving = [name for name in assembly.model.limbs[arm.limb].short_names if name not in held]
    return {
        name: planar_masses(assembly.model, arm.limb, moving, angles) for name, angles in READINGS.items()
    }


def _strikes(settings: Settings) -> dict[float, Pair]:
    """Strikes each surface with both robots."""
    surfaces = (WITHOUT_70_MS, WITH_70_MS) if settings.choose(0, 1, 1) == 0 else SURFACES
    robots = assembled(rotors=True), assembled(rotors=False)
    found: dict[float, Pair] = {}
    for number, stiffness in enumerate(surfaces):
        settings.on_progress(number / len(surfaces), f"surface of {stiffness:g} N/m")
        heavy, light = (first_contact(against(robot, stiffness), settings.seed) for robot in robots)
        found[stiffness] = (heavy, light)
    return found


def _summary(strikes: dict[float, Pair]) -> str:
    heavy, light = strikes[WITH_70_MS]
    return (
        "The planar arm of fig. 3-8, its apparent mass with and without reflected inertia; then `impact`, one task "
        "run on the plant twice, as it is and with `without-reflected-inertia.yaml`. Plant, model and "
        "damping design use the same patch; equilibria and springs are the same.\n\n"
        f"On the same surface of {WITH_70_MS / 1000:g} kN/m the hand stays {1e3 * heavy.duration:.0f} ms with rotors "
        f"and {1e3 * light.duration:.0f} ms without. The mass measured at the surface is "
        f"{heavy.measured_mass:.1f} kg and {light.measured_mass:.1f} kg (impulse over change of speed), where (3.15) "
        f"gives {heavy.mass:.1f} kg and {light.mass:.1f} kg along the normal at the touch: reflected inertia cannot be "
        "left out. Its effect on the *peak* force is far smaller than on the impulse."
    )


def _mass_rows(masses: dict[str, Masses]) -> tuple[ThesisValue, ...]:
    reading = masses["joint angles"]
    rows = []
    for robot, printed in PRINTED.items():
        for which, value, mass in zip(("largest", "smallest"), printed, reading.extremes(robot), strict=True):
            reason = f"{NOT_FROM_POSTURE}; square root, as Appendix A draws it; the eigenvalue itself is {mass:.3g} kg"
            label = f"{which} apparent mass {robot} I_r, square root of the eigenvalue"
            rows.append(ThesisValue(label, value, round(math.sqrt(mass), 3), "kg as printed", reason))
    for which, index in (("largest", 0), ("smallest", 1)):
        quotient = PRINTED_RATIO[which]
        ratio = reading.extremes("with")[index] / reading.extremes("without")[index]
        label = f"ratio of the {which} apparent masses with / without I_r, read as"
        same = f"{NOT_FROM_POSTURE}; the printed ratio is one of square roots"
        rows.append(ThesisValue(f"{label} square roots", quotient, round(math.sqrt(ratio), 3), "", same))
        squared = f"{NOT_FROM_POSTURE}; {quotient} squared; what a touch measures"
        rows.append(
            ThesisValue(f"{label} masses", f"{quotient**2:.2f} (squared)", round(ratio, 3), "", squared)
        )
    rows += _shape_rows(reading)
    for robot, force in PRINTED_FORCE.items():
        mass = reading.extremes(robot)[0]
        label = f"F = m v / T {robot} I_r, {SPEED} m/s, {1e3 * CONTACT_TIME:g} ms, the planar arm's heaviest direction"
        as_printed, really = (value * SPEED / CONTACT_TIME for value in (math.sqrt(mass), mass))
        reason = f"the square root in the place of the mass, as in the thesis; the mass itself gives {really:.2f} N"
        rows.append(ThesisValue(label, force, round(as_printed, 3), "N", reason))
    return tuple(rows)


def _shape_rows(reading: Masses) -> list[ThesisValue]:
    """Lays Table 3.1's shape factors, largest over smallest mass, beside ours."""
    factors = {robot: math.sqrt(math.prod(_over(reading.extremes(robot)))) for robot in PRINTED_SHAPE}
    rows = [
        ThesisValue(
            f"shape factor {robot} I_r, largest over smallest",
            PRINTED_SHAPE[robot],
            round(factor, 3),
            "",
            f"{NOT_FROM_POSTURE}; of square roots; of the eigenvalues it is {factor**2:.2f}",
        )
        for robot, factor in factors.items()
    ]
    ratio = round(factors["with"] / factors["without"], 3)
    reason = f"{NOT_FROM_POSTURE}; of square roots; of the eigenvalues it is the square"
    printed = PRINTED_RATIO["shape factor"]
    return [*rows, ThesisValue("shape factor, with over without I_r", printed, ratio, "", reason)]


def _over(extremes: tuple[float, float]) -> tuple[float, float]:
    """Largest mass, and one over the smallest."""
    return extremes[0], 1.0 / extremes[1]


def _steps(strikes: dict[float, Pair]) -> dict[str, float]:
    """What the ratio of mean forces at one contact time is made of; the product of all but the first is the last."""
    heavy, light = strikes[WITH_70_MS][0], strikes[WITHOUT_70_MS][1]
    turned = [1.0 + hit.left / hit.speed for hit in (heavy, light)]
    return {
        "masses predicted": heavy.mass / light.mass,
        "measured masses (impulse over change of speed)": heavy.measured_mass / light.measured_mass,
        "change of speed for each m/s of arrival": turned[0] / turned[1],
        "contact times, inverted": light.duration / heavy.duration,
        "mean forces": _mean(heavy) / _mean(light),
    }


def _step_table(strikes: dict[float, Pair]) -> ResultTable:
    rows: list[list[Cell]] = [[name, round(value, 3)] for name, value in _steps(strikes).items()]
    caption = (
        f"From masses to mean forces, with rotors on {WITH_70_MS / 1000:g} kN/m over without on "
        f"{WITHOUT_70_MS / 1000:g} kN/m: the last is the product of the three before it"
    )
    return ResultTable(caption, ("with / without", "ratio"), rows)


def _mean(impact: Impact) -> float:
    """Mean force for each m/s of arrival [N.s/m]."""
    return impact.impulse / impact.duration / impact.speed


def _ratios(strikes: dict[float, Pair]) -> dict[str, float]:
    """With over without rotors."""
    heavy, light = strikes[WITH_70_MS]
    slower = strikes[WITHOUT_70_MS][1]
    return {
        "predicted mass": heavy.mass / light.mass,
        "measured mass": heavy.measured_mass / light.measured_mass,
        "impulse": heavy.impulse / heavy.speed / (light.impulse / light.speed),
        "peak force": heavy.peak / heavy.speed / (light.peak / light.speed),
        "mean force, same surface": _mean(heavy) / _mean(light),
        "mean force, same contact time": _mean(heavy) / _mean(slower),
    }


def _impact_rows(strikes: dict[float, Pair]) -> tuple[ThesisValue, ...]:
    heavy, light = strikes[WITH_70_MS]
    slower = strikes[WITHOUT_70_MS][1]
    ratios = _ratios(strikes)
    reasons = {
        "predicted mass": "1 / (n^T Lambda^-1 n) of all seven joints at the touch",
        "measured mass": "impulse over change of speed",
        "mean force, same contact time": f"{1e3 * heavy.duration:.0f} ms and {1e3 * slower.duration:.0f} ms, "
        f"surfaces of {WITH_70_MS / 1e3:g} and {WITHOUT_70_MS / 1e3:g} kN/m; springs shield the rotors, see the table "
        "of steps",
        "mean force, same surface": "a lighter arm rebounds sooner",
        "impulse": "for each m/s of arrival, same surface",
        "peak force": "the first peak is the links' alone: the springs shield the rotors",
    }
    printed = {"mean force, same contact time": PRINTED_RATIO["forces"]}
    rows = [
        ThesisValue(
            f"the same with I_r, posture of `{TASK}`",
            PRINTED_FORCE["with"],
            heavy.mass * SPEED / CONTACT_TIME,
            "N",
            MASS,
        ),
        ThesisValue(
            f"the same without, posture of `{TASK}`",
            PRINTED_FORCE["without"],
            light.mass * SPEED / CONTACT_TIME,
            "N",
            MASS,
        ),
        ThesisValue(
            f"contact time with I_r {TUNED}",
            1e3 * CONTACT_TIME,
            1e3 * heavy.duration,
            "ms",
            "the surface's stiffness was tuned to it",
        ),
    ]
    for name, value in ratios.items():
        rows.append(ThesisValue(_ratio_name(name), printed.get(name), round(value, 3), "", reasons[name]))
    return tuple(rows)


def _ratio_name(name: str) -> str:
    return f"{name}, with / without {TUNED if name.endswith('contact time') else ''}".strip()


def _mass_table(masses: dict[str, Masses]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            "Table 3.1",
            "",
            *PRINTED["with"],
            *PRINTED["without"],
            PRINTED_RATIO["largest"],
            PRINTED_RATIO["smallest"],
        ]
    ]
    for name, found in masses.items():
        heavy, light = np.array(found.extremes("with")), np.array(found.extremes("without"))
        for reading, values in (("eigenvalue", (heavy, light)), ("square root", (heavy**0.5, light**0.5))):
            ratio = values[0] / values[1]
            rows.append([name, reading, *map(float, values[0]), *map(float, values[1]), *map(float, ratio)])
    columns = (
        "angles read as",
        "mass read as",
        "max with",
        "min with",
        "max without",
        "min without",
        "max ratio",
        "min ratio",
    )
    return ResultTable("Apparent mass of the planar arm at 3 pi/4, 3 pi/4, pi/2 [kg]", columns, rows)


def _impact_table(strikes: dict[float, Pair]) -> ResultTable:
    rows: list[list[Cell]] = []
    for stiffness, pair in strikes.items():
        for name, hit in zip(("with", "without"), pair, strict=True):
            speeds = (1e3 * hit.speed, 1e3 * hit.left, 1e3 * hit.duration)
            rows.append(
                [_surface_name(stiffness), name, *speeds, hit.peak, hit.impulse, hit.measured_mass, hit.mass]
            )
    columns = (
        "surface [N/m]", "I_r", "arrives [mm/s]", "leaves [mm/s]", "stays [ms]", "peak [N]", "impulse [N.s]",
        "measured mass [kg]", "predicted mass [kg]",
    )  # fmt: skip
    return ResultTable("The first touch on the plant", columns, rows)


def _surface_name(stiffness: float) -> str:
    tuned = stiffness in (WITH_70_MS, WITHOUT_70_MS)
    return f"{stiffness:g} {TUNED}" if tuned else f"{stiffness:g}"


def _ellipses(masses: dict[str, Masses]) -> Plot:
    """Draws u^T Lambda u over directions as the thesis does: half axes are the masses."""
    figure, columns = panels((7.0, 3.9), 1, 2, sharex=True, sharey=True)
    for axes, (name, found) in zip(columns, masses.items(), strict=True):
        for robot, colour in (("with", "C3"), ("without", "C0")):
            _draw_mass(axes, found.inverse[robot], colour, f"{robot} I_r")
        axes.set(
            xlim=(-10, 10),
            ylim=(-10, 10),
            aspect="equal",
            title=name,
            xlabel="outwards [kg]",
            ylabel="up [kg]",
        )
        axes.grid(alpha=0.3)
    figure.legend(*columns[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return Plot("mass", "Apparent mass by direction, half axes are eigenvalues of Lambda (fig. 3-9)", figure)


def _draw_mass(axes: Axes, inverse: np.ndarray, colour: str, label: str) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(*(np.linalg.inv(inverse) @ np.vstack([np.cos(turn), np.sin(turn)])), color=colour, label=label)


def _forces(strikes: dict[float, Pair]) -> Plot:
    figure, columns = panels((7.0, 3.2), 1, 2, sharex=True, sharey=True)
    surfaces = (WITH_70_MS, WITHOUT_70_MS)
    for axes, stiffness in zip(columns, surfaces, strict=True):
        for hit, colour, label in zip(strikes[stiffness], ("C3", "C0"), ("with I_r", "without"), strict=True):
            axes.plot(1e3 * hit.time, hit.force * SPEED / hit.speed, color=colour, label=label)
        axes.set(title=f"surface of {stiffness / 1000:g} kN/m", xlabel="since the touch [ms]")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel(f"normal force at {SPEED} m/s [N]")
    figure.legend(*columns[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return Plot("force", f"Force on the surface, scaled to an arrival at {SPEED} m/s", figure)


def _facts(masses: dict[str, Masses], strikes: dict[float, Pair]) -> dict[str, float]:
    heavy, light = strikes[WITH_70_MS]
    reading = masses["joint angles"]
    return {
        **{f"ratio of {name}": value for name, value in _ratios(strikes).items()},
        "steps": math.prod(list(_steps(strikes).values())[1:-1]),
        "contact time": heavy.duration,
        "contact time without, softer surface": strikes[WITHOUT_70_MS][1].duration,
        "measured mass over predicted, with": heavy.measured_mass / heavy.mass,
        "measured mass over predicted, without": light.measured_mass / light.mass,
        "largest mass with": reading.extremes("with")[0],
        "smallest mass with": reading.extremes("with")[1],
        "largest mass without": reading.extremes("without")[0],
        "smallest mass without": reading.extremes("without")[1],
    }
