# SPDX-License-Identifier: BSD-3-Clause
"""Equilibria and gains along the phase clock, compiled, and how far the clock may go: as far as the tank can pay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.control.compiled_memory import (
    BIAS_DAMPING,
    BIAS_STIFFNESS,
    CONSTANTS,
    DAMPING,
    FORCE,
    MOVER_COUNT,
    MOVERS,
    OFFSETS,
    REST,
    REST_ENDS,
    RIDES,
    SCALARS,
    SIZES,
    SLOTS,
    STIFFNESS,
    TARGET_ROTATION,
    TARGET_TRANSLATION,
    TIME,
    one,
    three,
    two,
    whole,
)
from impedance_modules.control.memory import (
    BLEND_TIME,
    BLENDED,
    CLOCK,
    DURATION,
    GRANTED,
    GRIP,
    GRIP_START,
    PERIOD,
)
from impedance_modules.modules.compiled_motion import COLUMNS, minimum_jerk, targets
from impedance_modules.modules.compiled_springs import bias_energy, spring_energies
from impedance_modules.safety import compiled_ledger
from impedance_modules.safety.compiled_ledger import SHORT

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TRIALS = 12
"""Bisections for the largest affordable part of a motion, as in ``ledger.grant``."""


@compiled
def _blend(memory: Array, at: Indices, springs: int, n: int, clock: float) -> None:
    """Sets the gains now in force: minimum jerk from the last phase's to this phase's."""
    time = one(memory, at, TIME)
    if time[BLENDED] > 0.0 and clock >= time[BLEND_TIME]:
        return
    part = minimum_jerk(clock / time[BLEND_TIME])
    for which, entries in (
        (STIFFNESS, springs * 36),
        (DAMPING, springs * 36),
        (FORCE, springs * 6),
        (BIAS_DAMPING, n * n),
    ):
        block = memory[at[which] : at[which + 1]]
        for k in range(entries):
            first = block[k]
            block[2 * entries + k] = first + part * (block[entries + k] - first)
    time[GRIP] = time[GRIP_START] + part * (1.0 - time[GRIP_START])
    time[BLENDED] = 1.0 if clock >= time[BLEND_TIME] else 0.0


@compiled
def _place(
    memory: Array, at: Indices, integers: Indices, where: Indices, n: int, springs: int, clock: float
) -> None:
    """Sets gains and equilibria to a phase clock."""
    _blend(memory, at, springs, n, clock)
    ends = two(memory, at, REST_ENDS, n)
    movers = two(memory, at, MOVERS, COLUMNS)
    targets(
        movers[: integers[where[MOVER_COUNT]]],
        whole(integers, where, RIDES),
        two(memory, at, OFFSETS, 12),
        ends[0],
        ends[1],
        one(memory, at, TIME)[DURATION],
        clock,
        three(memory, at, TARGET_ROTATION, 3, 3),
        two(memory, at, TARGET_TRANSLATION, 3),
        one(memory, at, REST),
    )


@compiled
def potential_energy(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    springs: int,
    q: Array,
    rotation: Array,
    translation: Array,
) -> float:
    """Returns U of all springs and joint biases at the gains and equilibria now in force [J]."""
    stiffness = three(memory, at, STIFFNESS, 6, 6)[2 * springs :]
    total = spring_energies(
        stiffness,
        whole(integers, where, SLOTS),
        rotation,
        translation,
        three(memory, at, TARGET_ROTATION, 3, 3),
        two(memory, at, TARGET_TRANSLATION, 3),
    )
    return total + bias_energy(one(memory, at, BIAS_STIFFNESS), one(memory, at, REST), q)


@compiled
def place_start(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    q: Array,
    rotation: Array,
    translation: Array,
) -> float:
    """Sets gains and equilibria at the phase clock as it stands and returns U there [J]."""
    sizes = whole(integers, where, SIZES)
    one(memory, at, TIME)[BLENDED] = 0.0
    _place(memory, at, integers, where, sizes[0], sizes[1], one(memory, at, TIME)[CLOCK])
    return potential_energy(memory, at, integers, where, sizes[1], q, rotation, translation)


@compiled
def move(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    n: int,
    springs: int,
    q: Array,
    rotation: Array,
    translation: Array,
) -> None:
    """Advances the phase clock by one period, or by the part of it that the tank can pay for."""
    time, scalars = one(memory, at, TIME), one(memory, at, SCALARS)
    constants = one(memory, at, CONSTANTS)
    before, period = time[CLOCK], time[PERIOD]
    budget = compiled_ledger.budget(scalars, constants)
    part, granted, refused = 1.0, 0.0, 1.0
    potential = 0.0
    for _ in range(TRIALS + 1):
        _place(memory, at, integers, where, n, springs, before + part * period)
        potential = potential_energy(memory, at, integers, where, springs, q, rotation, translation)
        affordable = compiled_ledger.change_cost(scalars, potential) <= budget
        if affordable:
            granted = part
        else:
            refused = part
        if granted == 1.0:
            break
        part = 0.5 * (granted + refused)
    if granted == 0.0:
        scalars[SHORT] = 1.0
    if granted < 1.0:
        _place(memory, at, integers, where, n, springs, before + granted * period)
        potential = potential_energy(memory, at, integers, where, springs, q, rotation, translation)
    compiled_ledger.take_change(scalars, constants, potential)
    time[CLOCK] = before + granted * period
    time[GRANTED] = granted
