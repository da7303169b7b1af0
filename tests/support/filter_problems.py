# SPDX-License-Identifier: BSD-3-Clause
"""Random two-limb filter problems for tests and benchmarks: no robot, only plausible numbers."""

from typing import Any, TypeVar

import numpy as np

from impedance_modules.records import Record
from impedance_modules.safety.filter_problem import FilterLayout, FilterProblem, FilterState, make_problem
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.safety.metric import write_metric
from impedance_modules.safety.rows import write_rows

PER_LIMB = 7
N = 2 * PER_LIMB
LAYOUT = FilterLayout(tuple(f"j{i}" for i in range(N)), tuple(f"pair{i}" for i in range(10)))
ARMS = np.array([[0, PER_LIMB], [PER_LIMB, N]])
COUPLED = np.repeat(ARMS, PER_LIMB, axis=1)
EFFORT = np.tile([50.0, 50.0, 50.0, 50.0, 15.0, 15.0, 15.0], 2)


AnyRecord = TypeVar("AnyRecord", bound=Record)


def changed(record: AnyRecord, **values: Any) -> AnyRecord:
    """A copy of a record with some arrays or numbers replaced."""
    kept = record.snapshot() | values
    return type(record)(**{k: np.array(v) if isinstance(v, np.ndarray) else v for k, v in kept.items()})


def limits(rng: np.random.Generator, period: float = 1e-3) -> FilterLimits:
    return FilterLimits(
        effort_max=EFFORT.copy(),
        effort_rate_max=rng.uniform(500.0, 5000.0, N),
        position_min=np.full(N, -2.0),
        position_max=np.full(N, 2.0),
        velocity_max=np.full(N, 2.0),
        deceleration=rng.uniform(5.0, 30.0, N),
        return_speed=np.full(N, 0.2),
        margin=0.02,
        approach_time=20 * period,
        separation_speed=0.1,
        separation_acceleration=5.0,
        period=period,
        delay=2 * period,
        horizon=5 * period,
        pair_horizon=4 * period,
        reflected_inertia=np.full(N, 0.05),
        compliance=np.where(np.arange(N) % PER_LIMB == 0, 0.0, 1.0 / 500.0),
    )


def limb(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Inertia (7, 7) with eigenvalues from 0.05 to 2 kg.m^2 and a Jacobian (6, 7), sometimes singular."""
    basis = np.linalg.qr(rng.normal(size=(PER_LIMB, PER_LIMB)))[0]
    inertia = basis @ np.diag(10.0 ** rng.uniform(-1.3, 0.3, PER_LIMB)) @ basis.T
    jacobian = rng.normal(size=(6, PER_LIMB)) * 0.5
    if rng.random() < 0.2:
        jacobian[rng.integers(6)] = jacobian[rng.integers(6)]
    return inertia, jacobian


def state(rng: np.random.Generator, spread: float = 0.8, moving: bool = True) -> FilterState:
    """A cycle; ``spread`` 1 reaches the limits, more lies outside."""
    inverse, jacobian = np.zeros((N, N)), np.zeros((2, 6, N))
    for hand, part in enumerate((slice(0, PER_LIMB), slice(PER_LIMB, N))):
        inertia, jacobian[hand][:, part] = limb(rng)
        inverse[part, part] = np.linalg.inv(inertia)
    velocity = rng.uniform(-2.0, 2.0, N) * spread * moving
    pairs = len(LAYOUT.pairs)
    return FilterState(
        q=rng.uniform(-2.0, 2.0, N) * spread,
        v=velocity,
        link_velocity=velocity * rng.uniform(0.9, 1.1, N),
        push=rng.normal(size=N) * moving,
        swing=rng.normal(size=N) * 0.3 * moving,
        load=rng.normal(size=N) * 2.0 * moving,
        motor_velocity=velocity * rng.uniform(0.9, 1.1, N),
        inverse_inertia=0.5 * (inverse + inverse.T),
        bias=rng.normal(size=N) * 2.0 * moving,
        jacobian=jacobian,
        previous=rng.uniform(-0.5, 0.5, N) * EFFORT,
        available=float(rng.choice([0.0, 0.01, 1.0, 100.0])),
        distance=rng.uniform(-0.02 if spread > 1.0 else 0.03, 0.3, pairs),
        gradient=rng.normal(size=(pairs, N)) * 0.3,
        drift=rng.normal(size=pairs) * moving,
    )


def blank(layout: FilterLayout = LAYOUT) -> FilterProblem:
    """A problem of these two limbs that asks for nothing."""
    return make_problem(layout, np.full(N, np.inf), COUPLED, ARMS)


def build(
    problem: FilterProblem, limits: FilterLimits, state: FilterState, desired: np.ndarray
) -> FilterProblem:
    """Writes a cycle's problem as the control cycle does."""
    problem.desired[:], problem.effort_max[:] = desired, limits.effort_max
    write_metric(problem, state)
    write_rows(problem, limits, state)
    return problem


def problem(rng: np.random.Generator, spread: float, demand: float, moving: bool = True) -> FilterProblem:
    """One built problem; ``demand`` is the desired torque in torque limits."""
    desired = rng.normal(size=N) * demand * EFFORT
    return build(blank(), limits(rng), state(rng, spread, moving), desired)


def single(**arrays: np.ndarray) -> FilterProblem:
    """One joint, unit metric, no limit but those given."""
    return changed(make_problem(FilterLayout(("j",), ()), np.full(1, np.inf)), **arrays)
