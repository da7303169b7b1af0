# SPDX-License-Identifier: BSD-3-Clause
"""Small worlds for the tank's tests: springs, a delayed command path, elastic joints stepped exactly."""

from collections import deque
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from impedance_modules.safety.tank import (
    Tank,
    admit,
    budget,
    change_cost,
    fill,
    limit_to_budget,
    make_tank,
)
from impedance_modules.safety.tank_settings import TankSettings


def settings_of(n: int, **changes: object) -> TankSettings:
    base = TankSettings(
        initial=2.0,
        max=4.0,
        floor=0.5,
        period=0.002,
        delay=0,
        hold=0.002,
        speed_bound=np.full(n, 2.0),
        compliance=np.full(n, 1 / 300),
        sensing_error=np.zeros(n),
        sensing_deviation=None,
        recovery_time=0.2,
    )
    return replace(base, **changes)


def filled_tank(settings: TankSettings, q: np.ndarray, effort: np.ndarray, potential: float) -> Tank:
    """The ledger before the first command."""
    tank = make_tank(settings)
    fill(tank, q, effort, potential)
    return tank


def altered(tank: Tank, **changes: object) -> Tank:
    """A copy of a ledger with some entries replaced."""
    copy = deepcopy(tank)
    for name, value in changes.items():
        if isinstance(value, np.ndarray):
            getattr(copy, name)[:] = value
        else:
            setattr(copy, name, value)
    return copy


def still_tank(settings: TankSettings, potential: float = 0.0, **changes: object) -> Tank:
    """A ledger before the first command of an arm that stands at zero without effort, some entries replaced."""
    zero = np.zeros_like(settings.speed_bound)
    return altered(filled_tank(settings, zero, zero, potential), **changes)


def limited(tank: Tank, wanted: np.ndarray, *, stopping: bool = False) -> np.ndarray:
    """The torque that may leave; ``wanted`` stays as it is."""
    effort = wanted.copy()
    limit_to_budget(tank, effort, stopping)
    return effort


def admit_part(tank: Tank, potential_at: Callable[[float], float]) -> float:
    """Makes the largest part of a change that the tank can pay, to 1/4096, as the control cycle does."""
    allowed, part, admitted, refused = budget(tank), 1.0, 0.0, 1.0
    kept = tank.potential
    for _ in range(13):
        potential = potential_at(part)
        if change_cost(tank, potential) <= allowed:
            admitted, kept = part, potential
        else:
            refused = part
        if admitted == 1.0:
            break
        part = 0.5 * (admitted + refused)
    tank.short = tank.short or admitted == 0.0
    admit(tank, kept)
    return admitted


def stored(tank: Tank) -> float:
    """T + r U [J]."""
    return tank.level + tank.spring_scale * tank.potential


def sensing_uncertainty(tank: Tank) -> float:
    """How far ``tank.work`` can be from the true integral of tau_applied . dtheta [J] (docs/passivity.md).

    Summation by parts: ``sum_k |tau_k - tau_(k-1)| e`` (charged already) ``+ |tau_n| e`` (the end term, kept
    in the tank), and twice what was assumed in missed cycles. 0 with exact sensors.
    """
    return tank.charged + float(np.abs(tank.applied) @ tank.sensing_error) + 2.0 * tank.assumed


@dataclass
class Springs:
    """U = (q - x0)^T K (q - x0) / 2, viscous damping and a constant push that no potential pays for."""

    K: np.ndarray
    x0: np.ndarray
    D: float
    push: np.ndarray

    def potential(self, q: np.ndarray, x0: np.ndarray | None = None, K: np.ndarray | None = None) -> float:
        d = q - (self.x0 if x0 is None else x0)
        return 0.5 * float(d @ (self.K if K is None else K) @ d)

    def effort(self, q: np.ndarray, v: np.ndarray, scale: float) -> np.ndarray:
        return scale * (self.K @ (self.x0 - q)) - self.D * v + self.push


def random_springs(rng: np.random.Generator, n: int) -> Springs:
    A = rng.normal(size=(n, n))
    K = rng.uniform(1, 200) * A @ A.T
    return Springs(K, rng.normal(size=n), rng.uniform(0, 5), rng.normal(size=n) * 5)


class Wire:
    """The robot's command path: a command of cycle k acts in [k + delay, k + delay + 1], and is held on."""

    def __init__(self, delay: int, n: int) -> None:
        self.line = deque([np.zeros(n)] * delay)
        self.last = np.zeros(n)

    def applied(self, command: np.ndarray | None) -> np.ndarray:
        """Torque of the next interval; None: no new command came, the last one stays."""
        self.last = self.last if command is None else command
        self.line.append(self.last)
        return self.line.popleft()


class ElasticArm:
    """n joints: M qdd + C qd = k (theta - q) + f, I thetadd + D thetad = tau - k (theta - q); exact steps."""

    def __init__(self, rng: np.random.Generator, n: int, dt: float) -> None:
        A = rng.normal(size=(n, n))
        self.n, self.k = n, rng.uniform(100, 900, n)
        M, inertia = A @ A.T + 0.3 * np.eye(n), rng.uniform(0.05, 0.6, n)
        Z, E, K = np.zeros((n, n)), np.eye(n), np.diag(self.k)
        Mi, Ii = np.linalg.inv(M), np.diag(1 / inertia)
        accelerations = [[-Mi @ K, Mi @ K, -0.2 * Mi, Z], [Ii @ K, -Ii @ K, Z, -0.1 * Ii]]
        F = np.block([[Z, Z, E, Z], [Z, Z, Z, E], *accelerations])
        G = np.block([[Z, Z], [Z, Z], [Mi, Z], [Z, Ii]])
        big = expm(np.block([[F, G], [np.zeros((2 * n, 6 * n))]]) * dt)
        self.A, self.B = big[: 4 * n, : 4 * n], big[: 4 * n, 4 * n :]
        self.x = np.zeros(4 * n)
        self.M, self.inertia = M, inertia

    def step(self, force: np.ndarray, tau: np.ndarray) -> None:
        self.x = self.A @ self.x + self.B @ np.concatenate((force, tau))

    def part(self, i: int) -> np.ndarray:
        return self.x[i * self.n : (i + 1) * self.n]
