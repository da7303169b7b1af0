# SPDX-License-Identifier: BSD-3-Clause
"""How large an effect looks in the logs, in units of the noise, and how to give it a wanted size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.excitation import Motion
from benchmarks.blind.injection import Injection
from benchmarks.blind.logs import record
from benchmarks.blind.plant import Arm, Noise, rigid_model, simulate
from benchmarks.blind.residual import inertia_columns, net_of_inertias, residual

Array = NDArray[np.float64]

PORTS = ("actuator", "link", "sensor")
ALIKE = 20.0
"""Sum of squares over noise below which two causes count as one in a log."""
APART = 40.0
"""Sum above which a good method must tell them apart."""
PRIOR = 0.03
"""Relative standard error of link inertias that an honest diagnosis must allow for."""
FINE = 1e-9
"""Grid [rad, N.m] of the sensors in runs without noise: rounding counts as noise."""


@dataclass(frozen=True)
class Size:
    """Rms of an effect in the residual of a nominal arm over the noise's rms there.

    Attributes:
        net: Less what inertia errors can imitate; the largest over joints and ports. This labels a case.
        raw: As it stands.
        weakest: Net size there in the motion that shows it least.
        port: Where it is largest.
        joint: Index of the joint where it is largest.
    """

    net: float
    raw: float
    weakest: float
    port: str
    joint: int


def _applied(injection: Injection, amplitude: float, arm: Arm, episode: int) -> Arm:
    return injection.apply(arm, amplitude, episode)


class NoiseScale:
    """Runs the arm without and with an effect, both without noise, and compares."""

    def __init__(
        self, arm: Arm, motions: Sequence[Motion], gains: tuple[Array, Array], level: float, seed: int
    ) -> None:
        """Measures the noise of an arm (its noise ``level`` and ``seed``) on motions of one length under some gains."""
        fine = replace(arm.drive, position_resolution=FINE, effort_resolution=FINE)
        self._motions, self._gains, self._arm = motions, gains, replace(arm, drive=fine)
        self._model = rigid_model(arm.believed, arm.side)
        quiet = [self._columns(self._arm, motion, None) for motion in motions]
        self._quiet = [residual(one, arm.drive, self._model) for one in quiet]
        noisy = [self._columns(arm, motion, Noise(seed + i, level)) for i, motion in enumerate(motions)]
        excess = [
            residual(one, arm.drive, self._model) - base for one, base in zip(noisy, self._quiet, strict=True)
        ]
        self.noise: Array = np.sqrt(np.mean(np.concatenate(excess, axis=1) ** 2, axis=1))
        inertia = [inertia_columns(one, arm.believed, arm.side, PRIOR) for one in quiet]
        self._inertia = np.concatenate(inertia, axis=0)

    def signature(self, apply: Callable[[Arm, int], Arm]) -> tuple[Array, Array]:
        """Returns what ``apply(arm, episode)`` adds, (3, samples, n) in units of noise: raw, and net of inertias."""
        found = []
        for i, motion in enumerate(self._motions):
            columns = self._columns(apply(self._arm, i), motion, None)
            found.append(residual(columns, self._arm.drive, self._model) - self._quiet[i])
        change = np.concatenate(found, axis=1)
        raw = change / self.noise[:, None, :]
        net = raw.copy()
        net[1] = net_of_inertias(change[1], self.noise[1], self._inertia)
        return raw, net

    def excess(self, logs: Sequence[Mapping[str, Array]], arms: Sequence[Arm]) -> Array:
        """Returns what recorded logs hold beyond noiseless runs of arms, (3, samples, n), net of inertias."""
        found = []
        for log, arm, motion in zip(logs, arms, self._motions, strict=True):
            fine = replace(arm, drive=self._arm.drive)
            ideal = residual(self._columns(fine, motion, None), self._arm.drive, self._model)
            found.append(residual(log, self._arm.drive, self._model) - ideal)
        change = np.concatenate(found, axis=1)
        net = change / self.noise[:, None, :]
        net[1] = net_of_inertias(change[1], self.noise[1], self._inertia)
        return net

    def size(self, apply: Callable[[Arm, int], Arm]) -> Size:
        """Returns the size of what ``apply(arm, episode)`` adds."""
        signatures = self.signature(apply)
        raw, net = (np.sqrt(np.mean(part**2, axis=1)) for part in signatures)
        port, joint = (int(i) for i in np.unravel_index(int(np.argmax(net)), net.shape))
        shares = np.split(signatures[1][port, :, joint], len(self._motions))
        weakest = min(float(np.sqrt(np.mean(share**2))) for share in shares)
        return Size(float(net.max()), float(raw.max()), weakest, PORTS[port], joint)

    def apart(self, one: Injection, amplitude: float, other: Injection) -> tuple[float, float]:
        """Measures what of one effect another cannot imitate, at the amplitude that imitates it best.

        Returns:
            Rms over noise where it is largest, and the sum of squares over all independent samples: below
            about 10 no method can tell the two apart, above 30 every good one can.
        """
        _, seen = self.signature(partial(_applied, one, amplitude))
        strength = float(np.sqrt(np.mean(seen**2, axis=1)).max())
        against, _ = self.tune(other, strength, tries=2)
        _, imitation = self.signature(partial(_applied, other, against))
        left = seen - np.sum(seen * imitation) / np.sum(imitation**2) * imitation
        return float(np.sqrt(np.mean(left**2, axis=1)).max()), float(np.sum(left**2))

    def tune(self, injection: Injection, wanted: float, tries: int = 5) -> tuple[float, Size]:
        """Returns the amplitude that gives a net size of 1 to 1.3 times the wanted, or as near as physics lets."""
        amplitude, tried = injection.first, []
        for _ in range(tries):
            size = self.size(partial(_applied, injection, amplitude))
            tried.append((abs(np.log(max(size.net, 1e-6) / (1.1 * wanted))), amplitude, size))
            if wanted <= size.net <= 1.3 * wanted:
                break
            step = float(np.clip(1.12 * wanted / max(size.net, 1e-6), 0.05, 20.0))
            nearer = min(amplitude * step, injection.most)
            if nearer == amplitude:
                break
            amplitude = nearer
        _, amplitude, size = min(tried, key=lambda one: one[0])
        return amplitude, size

    def _columns(self, arm: Arm, motion: Motion, noise: Noise | None) -> dict[str, Array]:
        return record(simulate(arm, motion, *self._gains, noise), arm.drive, arm.faults)
