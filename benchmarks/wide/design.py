# SPDX-License-Identifier: BSD-3-Clause
"""The dimensions of the benchmark, their values, which of them go together, and a draw in which all occur alike.

A case takes one value of every dimension. Of the values that go with what was already chosen, one is drawn among those
that occurred least; the order of the dimensions is drawn anew for each case.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from benchmarks.wide.frozen import FROZEN

DIMENSIONS: dict[str, tuple[str, ...]] = {
    "robot": ("baxter", "ur5", "ur10", "so100", "heavy_arm", "planar_1", "planar_2", "planar_3"),
    "mount": ("table", "ceiling", "wall", "tilted"),
    "rate": ("50", "100", "200", "250", "500", "1000"),
    "stamps": ("even", "jitter", "uneven", "dropped", "doubled", "bursts", "drifting"),
    "streams": ("command", "motor", "joint", "command+joint", "command+motor"),
    "gravity": ("robot", "robot_late", "command", "none"),
    "controller": ("position_loop", "computed_torque", "impedance"),
    "engine": ("mujoco_implicit", "mujoco_runge_kutta", "drake"),
    "friction": ("constraint", "lugre", "regularised"),
    "transmission": ("rigid", "spring"),
    "noise": ("white", "coloured", "quantised"),
    "velocity": ("differenced", "filtered", "observer", "absent"),
    "motion": ("identification", "pick_and_place", "teleoperation", "slow"),
    "repeats": ("repeated", "different"),
    "seconds": ("8", "12", "20"),
    "logs": ("1", "2", "3", "4", "5"),
    "known_by": ("robot_file", "urdf"),
}
RARE = {"seconds": ("60", "120"), "logs": ("8", "12")}
"""Values that one case in twelve has instead: they cost processor time."""
Values = Mapping[str, str]

RULES: tuple[tuple[str, Callable[[Values], bool]], ...] = (
    (
        "a spring is stated by a robot file",
        lambda v: v["transmission"] == "rigid" or v["known_by"] == "robot_file",
    ),
    (
        "a bare URDF states no filter of a velocity",
        lambda v: v["known_by"] == "robot_file" or v["velocity"] in ("differenced", "absent"),
    ),
    (
        "only MuJoCo has friction as a constraint",
        lambda v: v["friction"] != "constraint" or v["engine"] != "drake",
    ),
    (
        "a weight that nobody compensates needs an integral",
        lambda v: v["gravity"] != "none" or v["controller"] == "position_loop",
    ),
    ("one recording is no repeat", lambda v: v["logs"] != "1" or v["repeats"] == "different"),
    ("one recording must be long enough to be split", lambda v: v["logs"] != "1" or int(v["seconds"]) >= 12),
    ("many recordings are short ones", lambda v: int(v["logs"]) * int(v["seconds"]) <= 130),
)
"""What must hold of every case, with the reason."""


class _Partial(dict[str, str]):
    """Values so far: one that is not chosen yet stands in no rule's way."""

    def __missing__(self, key: str) -> str:
        raise LookupError(key)


def allowed(values: Values) -> bool:
    """Tells whether values go together, as far as they are chosen."""
    partial = _Partial(values)
    for _, rule in RULES:
        try:
            if not rule(partial):
                return False
        except LookupError:
            continue
    return True


def draw_cases(seed: tuple[int, ...], frozen: str | None = None) -> Iterator[dict[str, str]]:
    """Yields the values of one case after the other.

    Args:
        seed: Of the whole sequence.
        frozen: Dimension that always has its frozen value; None for development.
    """
    rng, seen = np.random.default_rng(seed), {name: Counter[str]() for name in DIMENSIONS}
    number = 0
    while True:
        number += 1
        values = None
        while values is None:
            values = _draw(number, frozen, seen, rng)
        for name, value in values.items():
            seen[name][value] += 1
        yield {name: values[name] for name in DIMENSIONS}


def _draw(
    number: int, frozen: str | None, seen: Mapping[str, Counter[str]], rng: np.random.Generator
) -> dict[str, str] | None:
    """Draws one case, dimension by dimension in a random order; None where no value of one goes with the others."""
    values: dict[str, str] = {} if frozen is None else {frozen: FROZEN[frozen]}
    for name in (str(one) for one in rng.permutation(list(DIMENSIONS)) if one not in values):
        rare = name in RARE and number % 12 == (0 if name == "logs" else 6)
        fitting = [
            value for value in (RARE if rare else DIMENSIONS)[name] if allowed({**values, name: value})
        ]
        if not fitting:
            return None
        fewest = min(seen[name][value] for value in fitting)
        values[name] = str(rng.choice([value for value in fitting if seen[name][value] == fewest]))
    return values
