# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot's own torque loops are passive at the rate of a run; ``robot/inner_torque_loop.py`` has the law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.robot.inner_torque_loop import (
    LoopTiming,
    PassiveGain,
    highest_passive_gain,
    loop_delay,
)
from impedance_modules.spec.document import scan_document
from impedance_modules.spec.locate import ROBOT_FILE
from impedance_modules.superposition.elastic_joints import sampling_of


@dataclass(frozen=True)
class InnerLoopLimit:
    """The robot's own torque loop beside what is passive.

    Attributes:
        gain: That the robot file states [1].
        limit: Of the joint that allows least.
        timing: Sampling and delay that both are judged with.
    """

    gain: float
    limit: PassiveGain
    timing: LoopTiming

    @property
    def passive(self) -> bool:
        """Whether no joint can give energy."""
        return self.gain <= self.limit.gain


def inner_loop_limit(assembly: Assembly) -> InnerLoopLimit | None:
    """Judges the robot's own torque loop; None where it has none."""
    loop = assembly.robot.inner_torque_loop
    if loop is None:
        return None
    sampling = sampling_of(assembly.robot, assembly.rate, True)
    period = 1.0 / (sampling.rate * sampling.robot_loops)
    timing = LoopTiming(period, period * loop_delay(loop, period))
    return InnerLoopLimit(loop.gain, highest_passive_gain(assembly.model.joints, timing), timing)


def beyond_passive_gain(assembly: Assembly) -> Iterator[Problem]:
    """Finds a gain with which a passive load can make a joint oscillate more and more."""
    found = inner_loop_limit(assembly)
    if found is None or found.passive:
        return
    limit = found.limit
    yield scan_document(assembly.robot.folder / ROBOT_FILE).problem(
        ("inner_torque_loop", "gain"),
        f"a gain of {found.gain:g} lets '{limit.joint}' give energy at {limit.frequency:.0f} rad/s: its torque loop"
        f" acts {1e3 * (found.timing.delay + 0.5 * found.timing.period):.2g} ms late",
        (f"at most {limit.gain:.2f}", "less delay", "run --allow-unstable in simulation"),
    )
