# SPDX-License-Identifier: BSD-3-Clause
"""Sanding as long as the thesis did, 15 minutes and 270 strokes, on wood that wears at the thesis's pace (5.2.3).

The wood of the tasks wears in a minute what took the thesis 15; here its resistance to wear is larger, such that the
tangential force near 20 Hz about halves over the whole time near the surface. Everything else is the tasks' own, but
for the energy tank, which holds as many times more as the sanding is longer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.parallel_runs import carry_out_all
from impedance_experiments.sanding_runs import (
    DEEP,
    MOST_WINDOWS,
    SHALLOW,
    DepthRuns,
    Sanding,
    board_of,
    numbers,
    sand,
    sanding_task,
)
from impedance_experiments.thesis_page import Cell, Plot, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.roughness_detection import BAND
from impedance_modules.errors import BadInput
from impedance_modules.spec.task import SurfaceSpec

WEAR = 55e3
"""Resistance to wear with which the force near 20 Hz about halves in 15 minutes near the surface [J/m^2]: tuned. With
30 kJ/m^2 a third of it was left, with 70 kJ/m^2 more than half.
"""
SECONDS = (24, 60, 900)
"""Time of sanding of the three sizes [s]."""
KEPT_EVERY = 1.0
"""Time from one kept value of the work to the next [s]."""


@dataclass(frozen=True)
class CourseJob:
    """A long sanding to be made: task, time of sanding [s], resistance to wear [J/m^2], seed of the noise."""

    task: str
    seconds: float
    wear: float
    seed: int


@dataclass(frozen=True)
class Course:
    """The course of a long sanding.

    Attributes:
        task: Its name.
        seconds: Time of sanding [s].
        windows: (W, 4) of every stroke towards the robot that is judged: when [s], tangential force in the band
            [N rms], coefficient of friction, normal force [N].
        work: (M, 2) every second: when [s], work done on the wood so far [J].
        left: (M, 3) every second: when [s], least and mean roughness left where the hand has rubbed.
        rubbed: Of that work, done by friction [J].
        broken: How many splinters broke.
        refused: How many strokes gave no window.
        tank: What the energy tank gave [J].
        ending: How it ended.
    """

    task: str
    seconds: float
    windows: Array
    work: Array
    left: Array
    rubbed: float
    broken: int
    refused: int
    tank: float
    ending: str

    @property
    def start(self) -> Array:
        """The first judged strokes, at most eight, (m, 4)."""
        return self.windows[: self._count]

    @property
    def end(self) -> Array:
        """The last ones."""
        return self.windows[-self._count :]

    @property
    def fall(self) -> float:
        """Force in the band at the end over that at the start."""
        return float(self.end[:, 1].mean() / self.start[:, 1].mean())

    @property
    def _count(self) -> int:
        return min(MOST_WINDOWS, len(self.windows) // 2)


def long_board(task: str, wear: float) -> SurfaceSpec:
    """Returns the task's piece of wood with another resistance to wear [J/m^2]."""
    board = board_of(sanding_task(task))
    if board.wood is None or board.wood.roughness is None:
        raise TypeError(f"task '{task}': its wood has no roughness to wear off")
    return replace(board, wood=replace(board.wood, roughness=replace(board.wood.roughness, wear=wear)))


def task_wear(task: str) -> float:
    """Gives the resistance to wear of the task's own wood [J/m^2]."""
    wood = board_of(sanding_task(task)).wood
    return 0.0 if wood is None or wood.roughness is None else wood.roughness.wear


def sand_long(job: CourseJob) -> Course:
    """Sands for a long time.

    Raises:
        BadInput: Fewer than two strokes could be judged.
    """
    assembly = sanding_task(job.task, board=long_board(job.task, job.wear), seconds=job.seconds)
    share = max(1.0, job.seconds / sanding_task(job.task).task.phases[-1].duration)
    tank = assembly.tank
    tank = replace(tank, initial=share * tank.initial, max=share * tank.max)
    run = sand(replace(assembly, tank=tank), job.seed)
    if len(run.windows) < 2:
        raise BadInput(
            f"task '{job.task}': too few windows in {job.seconds:g} s, {len(run.windows)} (valid: two)"
        )
    return _course(job, run)


def _course(job: CourseJob, run: Sanding) -> Course:
    windows = [(window.start, window.band, window.friction, window.normal) for window in run.windows]
    when = np.arange(0.0, float(run.time[-1]), KEPT_EVERY)
    return Course(
        task=job.task,
        seconds=job.seconds,
        windows=np.array(windows),
        work=np.column_stack([when, np.interp(when, run.time, run.work)]),
        left=run.left,
        rubbed=run.wood.rubbed,
        broken=run.wood.broken,
        refused=sum(run.refused.values()),
        tank=run.tank,
        ending=run.ending,
    )


def run_courses(settings: Settings) -> tuple[Course, Course]:
    """Sands for a long time near the surface and deep below it; what has been done is kept in the folder."""
    seconds = float(settings.choose(*SECONDS))
    jobs = [CourseJob(task, seconds, WEAR, settings.seed) for task in (SHALLOW, DEEP)]

    def on_done(number: int) -> None:
        settings.on_progress(0.1 * number, f"{seconds:g} s of sanding")

    shallow, deep = carry_out_all(sand_long, jobs, settings.work, on_done)
    return shallow, deep


def course_rows(names: Mapping[str, Course]) -> list[list[Cell]]:
    """Gives a row of the table of windows for start and end of every course."""
    return [
        [
            name,
            f"{course.seconds:.0f} s, {case}",
            len(windows),
            *(f"{windows[:, k].mean():.3f} ± {windows[:, k].std():.3f}" for k in (1, 2, 3)),
        ]
        for name, course in names.items()
        for case, windows in (("start", course.start), ("end", course.end))
    ]


def course_comparisons(
    shallow: Course, deep: Course, rate: float, printed: tuple[float, float], tuned: str
) -> Iterator[ThesisValue]:
    """Compares the long sanding with the thesis's.

    Args:
        shallow: Near the surface.
        deep: Below it.
        rate: Strokes in a second [Hz].
        printed: Of the thesis: cycles, what is left of the force near 20 Hz.
        tuned: Marks a number that follows from sizes of the wood that were chosen.
    """
    cycles, half = printed
    yield ThesisValue(
        "long sanding: cycles", f"{cycles:g}", round(shallow.seconds * rate), "1", f"in {shallow.seconds:g} s"
    )
    yield ThesisValue(
        f"long sanding: tangential force near the peak, end over start, shallow {tuned}",
        f"almost {half:g}",
        shallow.fall,
        "1",
        f"over {shallow.seconds / 60.0:g} minutes; the wear constant is tuned to it",
    )
    yield ThesisValue(
        "long sanding: the same, deep",
        "sanded down to the same extent",
        deep.fall,
        "1",
        f"the same wear constant; more normal force does more work, {deep.work[-1, 1]:.0f} J, and wears off more",
    )
    for name, course in (("shallow", shallow), ("deep", deep)):
        yield ThesisValue(
            f"long sanding: net work done on the wood, {name}",
            "done",
            float(course.work[-1, 1]),
            "J",
            f"{course.rubbed:.0f} J rubbed; splinters broken: {course.broken}; "
            f"the energy tank gave {course.tank:.0f} J",
        )


def course_plot(names: Mapping[str, Course], smooth: Mapping[str, DepthRuns]) -> Plot:
    """Draws the course of both measures, of the roughness that is left, and of the work, a column per depth."""
    figure, rows = panels((7.0, 7.0), 4, len(names), sharex=True, sharey="row", squeeze=False)
    for column, (name, course) in zip(rows.T, names.items(), strict=True):
        band, friction, left, work = column
        when = course.windows[:, 0] / 60.0
        for axes, k, measure in ((band, 1, "band"), (friction, 2, "friction")):
            axes.plot(when, course.windows[:, k], ".", color="C0", ms=3, label="rough wood, a stroke")
            plain = float(numbers(smooth[name].plain, measure).mean())
            axes.axhline(plain, color="C3", ls="--", lw=1.0, label="smooth wood, mean")
        left.plot(course.left[:, 0] / 60.0, 100.0 * course.left[:, 2], color="C2", label="mean")
        left.plot(course.left[:, 0] / 60.0, 100.0 * course.left[:, 1], color="C1", ls="--", label="least")
        work.plot(course.work[:, 0] / 60.0, course.work[:, 1], color="C0")
        band.set(title=name, ylim=(0.0, None))
        work.set_xlabel("time [min]")
        for axes in column:
            axes.grid(alpha=0.3)
    labels = (
        f"{BAND[0]:g} to {BAND[1]:g} Hz [N rms]",
        "coefficient of friction",
        "roughness left [%]",
        "work on wood [J]",
    )
    for axes, label in zip(rows[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    for row in (0, 2):
        handles, labels_there = rows[row, 0].get_legend_handles_labels()
        rows[row, -1].legend(handles, labels_there, loc="upper right")
    seconds = max(course.seconds for course in names.values())
    return Plot(
        "course",
        f"{seconds / 60.0:g} minutes of sanding: tangential force near the spectrum's peak and coefficient of friction "
        "in every stroke that is judged, roughness that is left where the hand has rubbed (its mean rises where the "
        "hand comes upon a fresh place), and work done on the wood",
        figure,
    )
