# SPDX-License-Identifier: BSD-3-Clause
"""The result of a diagnosis, as frozen data: everything that JSON, report and terminal print."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.gap_result import GapLocation, JointGap, ResidualSeries
from impedance_modules.diagnosis.rollout_result import CauseRollout, Rollout
from impedance_modules.effects.effect_description import Port

EXIT_CODES: Mapping[str, int] = {
    "no_gap": 0,
    "explained": 0,
    "partly_explained": 5,
    "unexplained": 5,
    "ambiguous": 6,
    "insufficient_data": 7,
}
"""Verdict -> exit code of the command line."""

DEFAULT_TOLERANCE = 0.01
"""Share of a joint's torque range within which a gap that changes no simulated motion is called none."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The whole result.

    ``tolerance`` is the share of joints' torque ranges within which a gap does not matter; ``small`` are the causes of
    a gap that is within it and changes no simulated motion, most explaining first. They are in no patch.
    ``swallowed`` is what was fitted within priors beside the causes; None without a fit. ``shrink`` is the gap's by the
    named causes alone, ``refitted_shrink`` with links, weights and stamps fitted beside them; None without a gap.
    """

    verdict: str
    robot: str
    episodes: tuple[str, ...]
    heldout: tuple[str, ...]
    data: DataReport | None
    reason: str
    gaps: tuple[JointGap, ...]
    shrink: float | None
    rollout: Rollout
    where: tuple[GapLocation, ...]
    causes: tuple[Cause, ...]
    unexplained_weight: float
    remainder: Remainder
    next_motion: Mapping[str, object]
    series: tuple[ResidualSeries, ...]
    tolerance: float = 0.0
    small: tuple[Cause, ...] = ()
    swallowed: Swallowed | None = None
    refitted_shrink: float | None = None

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return EXIT_CODES[self.verdict]


@dataclass(frozen=True)
class Adjustment:
    """A number that was fitted within its prior: its change in ``unit``, and its size in deviations of the prior.

    Of a link ``value`` is the change of its mass, and ``deviations`` the largest of its ten inertial parameters.
    """

    value: float
    unit: str
    deviations: float


@dataclass(frozen=True)
class HandMass:
    """A point mass on a link that makes a share of the torque that the links' prior swallowed.

    Attributes:
        link: Outermost link; the mass is at its centre of mass.
        mass: [kg]; negative where less mass would do the same.
        share: Of the swallowed torque's power.
    """

    link: str
    mass: float
    share: float


@dataclass(frozen=True)
class Swallowed:
    """What was fitted within priors, and is no finding.

    Attributes:
        links: Link -> change of its mass, and its largest deviation.
        weights: Largest deviation of the weights that the robot compensates.
        times: ``commands``, ``efforts``, ``velocities`` -> how much later they were stamped; and ``positions of
            compensated weights`` -> how old those were from which the robot computed them. Those that were fitted.
        hand: The mass in the hand that would do about the same as the links' change; None if none does.
    """

    links: Mapping[str, Adjustment]
    weights: float
    times: Mapping[str, Adjustment]
    hand: HandMass | None

    @property
    def largest(self) -> float:
        """Largest deviation of a link."""
        return max((link.deviations for link in self.links.values()), default=0.0)


@dataclass(frozen=True)
class Standing:
    """How far a cause stands out, in log-likelihood of recordings that no fit has seen, less penalties [nats].

    Attributes:
        gain: Over the model without it. Of a cause on several joints, where it gains least.
        lead: Over the best other candidate in its place, or over none. Candidates that cannot be told from it, or of
            which it is a special case, are not counted.
    """

    gain: float
    lead: float

    def least(self, other: Standing) -> Standing:
        """The standing of two parts of one cause together: it is as certain as the less certain one."""
        return Standing(min(self.gain, other.gain), min(self.lead, other.lead))


NOT_COMPARED = Standing(0.0, 0.0)
"""Of a cause that was compared with nothing."""


@dataclass(frozen=True)
class Grounds:
    """What a cause's probability follows from; `model_selection.probability` has the law.

    Attributes:
        gain, lead: Its standing [nats], not below 0.
        weight: Its part of the explained gap.
        deviations: Standard deviations by which its numbers differ from no effect; of several carriers, the least.
        lack_of_fit: Largest residual power that the causes leave, over what would pass.
        explained: Whether what they leave passes.
        motion: 1 where the simulated motion is better with it, -1 where it is worse, 0 where it makes no difference
            or was not simulated.
        repeats: Whether repeated motions measured the noise.
        alternatives: Candidates that cannot be told from it.
        others: Other causes beside it.
    """

    gain: float
    lead: float
    weight: float
    deviations: float
    lack_of_fit: float
    explained: bool
    motion: int
    repeats: bool
    alternatives: int
    others: int


@dataclass(frozen=True)
class Cause:
    """A named effect.

    Attributes:
        effect: Id.
        joints: Joints it acts on.
        port: actuator, link, sensor, timing or contact.
        parameters: Carrier -> symbol -> estimate.
        weight: Its part of the explained gap.
        shrink: Held-out shrink with this cause alone; None without a gap.
        equivalent: Candidates that these recordings cannot distinguish from it.
        rivals: Other candidates, and why they were rejected.
        position_range, velocity_range: Joint -> range of the data that the fit rests on.
        rollout: Its effect on the rollouts; None where it was not simulated.
        standing: How far it stands out on unseen recordings.
        probability: That this effect is present at these joints; None until the whole result is known.
        grounds: What the probability follows from.
        outside: Whether it is not of the robot, as its maker would know it: a patch states it as such.
        elsewhere: Other ports at which it would explain these recordings as well.
    """

    effect: str
    joints: tuple[str, ...]
    port: Port
    parameters: Mapping[str, Mapping[str, Estimate]]
    weight: float
    shrink: float | None
    equivalent: tuple[Rival, ...]
    rivals: tuple[Rival, ...]
    position_range: Mapping[str, tuple[float, float]]
    velocity_range: Mapping[str, tuple[float, float]]
    rollout: CauseRollout | None = None
    standing: Standing = NOT_COMPARED
    probability: float | None = None
    grounds: Grounds | None = None
    outside: bool = False
    elsewhere: tuple[Port, ...] = ()


@dataclass(frozen=True)
class Estimate:
    """An identified number with its standard deviation and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """A candidate that was rejected, or is indistinguishable from the cause."""

    effect: str
    joints: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class Remainder:
    """What the causes leave.

    Attributes:
        lack_of_fit: Largest residual power over noise.
        explained: Whether it passes.
        structure: In words.
        limit: Lack of fit that would pass; None where none was computed.
        failing: Comparisons, (residual, joint) as in `JointGap`, in which something more than noise is left.
    """

    lack_of_fit: float
    explained: bool
    structure: str
    limit: float | None = None
    failing: frozenset[tuple[str, str]] = frozenset()

    @property
    def of_velocities(self) -> bool:
        """Whether only reported velocities leave something: nothing is simulated with them."""
        return {residual for residual, _ in self.failing} == {"velocity"}
