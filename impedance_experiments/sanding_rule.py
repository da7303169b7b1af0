# SPDX-License-Identifier: BSD-3-Clause
"""A rule that says "finished", and the pieces of wood, drawn by seed, that it is set on and judged on (thesis 5.2).

A piece's score by one measure is the measure's mean over a run's first windows. On a soft backing a texture gives
little force and the spectrum says little; on slippery rough wood the coefficient of friction says little. The rule
therefore uses both, and the worse of the two,

    z = max_m (s_m - mean_m) / deviation_m,    mean and deviation over the smooth pieces that it is set on,

must stay below a bound. The bound lies as many deviations above the smooth pieces that it is set on as below the rough
ones, these in logarithms (they spread over decades): all pieces count, and not only the two next to it. A piece that
gives too few windows (stuck, out of contact) is not finished.

The ranges of the wood were fixed and committed before any rule that judges roughness was set on them. They are
assumptions; the thesis describes its wood in words only ("a splintered wood block", "a smooth piece of wood"):

- friction of sandpaper on planed wood 0.35 to 0.55, and 0.2 to 0.5 more on rough wood;
- hills of sawn wood 0.3 to 0.8 mm, of planed wood at most 0.08 mm, 8 to 14 mm apart (saw marks);
- sandpaper on hook-and-loop tape yields like a spring of 4 to 10 kN/m;
- one to six splinters per 200 cm^2, which bear 8 to 25 N;
- wear such that a minute of sanding does what took 15 in the thesis (about 20 times softer than real wood).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from scipy.optimize import brentq

from impedance_modules.arrays import Array
from impedance_modules.control.roughness_detection import Window
from impedance_modules.spec.task import RoughnessSpec, SplintersSpec, SurfaceSpec, WoodSpec

LEAST = 0.1
"""A rough piece whose score is below that of smooth ones on average counts as so far from them [deviations]."""
SPREADS = (0.5, 0.3)
"""Least deviations of smooth pieces and of the logarithms of rough ones; a few pieces scatter less than many."""
Range = tuple[float, float]
BASE_FRICTION: Range = (0.35, 0.55)
WAVELENGTH: Range = (0.008, 0.014)
BACKING_STIFFNESS: Range = (4e3, 1e4)
WEAR: Range = (4e3, 1.2e4)
LEAST_FORCE: Range = (8.0, 12.0)
MOST_FORCE: Range = (15.0, 25.0)
ENDURANCE: Range = (0.1, 0.4)
REACH = 0.004
"""How near the tool must come to a splinter [m]."""


@dataclass(frozen=True)
class RocCurve:
    """A receiver operating characteristic.

    Attributes:
        false, true: (m,) shares of rough and of smooth pieces on which the rule fires, as its bound grows.
        area: Under the curve; 0.5 is guessing.
    """

    false: Array
    true: Array
    area: float


@dataclass(frozen=True)
class SmoothStatistics:
    """Statistics of smooth wood.

    Attributes:
        mean, deviation: Measure -> over smooth pieces.
    """

    mean: Mapping[str, float]
    deviation: Mapping[str, float]

    def worst(self, scores: Mapping[str, Array]) -> Array:
        """How far pieces are from smooth wood by their worse measure (m,), in deviations of smooth pieces."""
        away = [(values - self.mean[name]) / self.deviation[name] for name, values in scores.items()]
        return np.asarray(np.max(away, axis=0))

    def bounds(self, bound: float) -> dict[str, float]:
        """Gives what each measure must stay below where the worse one must stay below ``bound``."""
        return {name: mean + bound * self.deviation[name] for name, mean in self.mean.items()}


def smooth_statistics(scores: Mapping[str, Array]) -> SmoothStatistics:
    """Takes the scores (m,) of smooth pieces by every measure; pieces without enough windows are left out."""
    known = {name: values[np.isfinite(values)] for name, values in scores.items()}
    deviations = {name: max(float(values.std()), 1e-3) for name, values in known.items()}
    return SmoothStatistics({name: float(values.mean()) for name, values in known.items()}, deviations)


def score(windows: tuple[Window, ...], measure: str, count: int) -> float:
    """Returns the mean of ``band`` or ``friction`` over a run's first windows; infinite with too few of them."""
    values = [float(getattr(window, measure)) for window in windows[:count]]
    return float(np.mean(values)) if len(values) == count else float("inf")


def set_bound(smooth: Array, rough: Array) -> float:
    """Finds the bound b with (b - mean_smooth) / deviation_smooth = (mean ln rough - ln b) / deviation of ln rough."""
    logs = np.log(np.maximum(rough[np.isfinite(rough)], LEAST))
    known = smooth[np.isfinite(smooth)]
    first, second = max(float(known.std()), SPREADS[0]), max(float(logs.std()), SPREADS[1])

    def excess(bound: float) -> float:
        return float((bound - known.mean()) / first - (logs.mean() - np.log(bound)) / second)

    top = 10.0 * (abs(float(known.mean())) + float(np.exp(logs.mean())) + first)
    return float(brentq(excess, 1e-6, top))


def roc_curve(smooth: Array, rough: Array) -> RocCurve:
    """Draws the curve of a rule over all its bounds."""
    bounds = np.concatenate([[-np.inf], np.sort(np.concatenate([smooth, rough]))])
    bounds = bounds[bounds < np.inf]
    false = np.array([*(np.mean(rough <= bound) for bound in bounds), 1.0])
    true = np.array([*(np.mean(smooth <= bound) for bound in bounds), 1.0])
    return RocCurve(false, true, float(np.trapezoid(true, false)))


class WoodKind(Enum):
    """Which wood."""

    ROUGH = "rough"
    SMOOTH = "smooth"


@dataclass(frozen=True)
class Ranges:
    """Between which numbers the pieces of one kind lie, evenly.

    Attributes:
        height: Of the highest hills [m].
        rough_friction: Coefficient that fresh wood adds.
        density: Of splinters [1/m^2]; both 0 for none.
    """

    height: Range
    rough_friction: Range
    density: Range


KINDS: dict[WoodKind, Ranges] = {
    WoodKind.ROUGH: Ranges(height=(3e-4, 8e-4), rough_friction=(0.2, 0.5), density=(50.0, 300.0)),
    WoodKind.SMOOTH: Ranges(height=(1e-5, 8e-5), rough_friction=(0.0, 0.08), density=(0.0, 0.0)),
}


def draw_wood(board: SurfaceSpec, kind: WoodKind, seed: int) -> SurfaceSpec:
    """Draws a piece of wood of the same shape and place as a task's board.

    Args:
        board: A box of the task's environment.
        kind: Rough or smooth.
        seed: Of this piece; the same for both kinds gives what they share the same values.
    """
    source = np.random.default_rng([seed, 2])
    ranges = KINDS[kind]

    def between(low_high: Range) -> float:
        return float(source.uniform(*low_high))

    friction, stiffness = between(BASE_FRICTION), between(BACKING_STIFFNESS)
    wavelength, wear = between(WAVELENGTH), between(WEAR)
    force, endurance = (between(LEAST_FORCE), between(MOST_FORCE)), between(ENDURANCE)
    height, rough_friction, density = (
        between(ranges.height),
        between(ranges.rough_friction),
        between(ranges.density),
    )
    splinters = SplintersSpec(density, force, endurance, REACH) if density > 0.0 else None
    wood = WoodSpec(seed, RoughnessSpec(height, wavelength, rough_friction, wear), splinters)
    return replace(board, friction=friction, stiffness=stiffness, wood=wood)
