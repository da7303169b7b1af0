# SPDX-License-Identifier: BSD-3-Clause
"""A rehearsed task as data: what every phase came to, and the arms sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion
from impedance_modules.prediction.mechanism import Setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PhaseRehearsal:
    """One phase as it was rehearsed.

    Attributes:
        name: Of the phase.
        modules: With its gains.
        damping: Designed at its start.
        motion: Of its equilibria.
        began, ended: When [s].
        clock: Where the phase's clock stopped: ``duration``, or earlier where ``until`` was met [s].
        met: Whether ``until`` was met; None without one.
        samples: Rows of the rehearsal that belong to it.
        q: (n,) where it ended [rad].
    """

    name: str
    modules: TaskModules
    damping: Damping
    motion: PhaseMotion
    began: float
    ended: float
    clock: float
    met: bool | None
    samples: slice
    q: Array

    @property
    def equilibrium(self) -> Equilibrium:
        """All equilibria where the phase ends."""
        return self.motion.at(self.clock)

    @property
    def setting(self) -> Setting:
        """What pulls where the phase ends."""
        return Setting(self.modules, self.equilibrium, self.damping)


@dataclass(frozen=True)
class Sample:
    """The rehearsed task at one instant; energies count from the start.

    Attributes:
        time: [s].
        q: (n,) [rad].
        effort: (n,) torque that the modules ask for [N.m].
        potential: U of springs and joint bias [J].
        work: Of that torque on the joints [J].
        kinetic: Of arms, rotors and object [J].
        rubbed: Lost on surfaces [J].
        friction: Lost in the motors' own friction [J].
    """

    time: float
    q: Array
    effort: Array
    potential: float
    work: float
    kinetic: float
    rubbed: float
    friction: float


@dataclass(frozen=True)
class Rest:
    """A static equilibrium.

    Attributes:
        q: (n,) [rad].
        effort: (n,) torque that the modules command [N.m].
        pressure: Hand frame or ``object`` -> (6,) of the surfaces on it, at its origin, world axes [N, N.m].
    """

    q: Array
    effort: Array
    pressure: Mapping[str, Array]


@dataclass(frozen=True)
class Rehearsal:
    """A whole task, rehearsed: its phases and samples."""

    phases: tuple[PhaseRehearsal, ...]
    samples: tuple[Sample, ...]
