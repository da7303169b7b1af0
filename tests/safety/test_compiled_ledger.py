# SPDX-License-Identifier: BSD-3-Clause
"""The compiled ledger books what the clear one books, over random lives of a tank."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace

import numpy as np
import pytest

from impedance_modules.safety import compiled_ledger, ledger
from impedance_modules.safety.compiled_ledger import LEVEL, POTENTIAL, SCALE, SHORT, Book
from impedance_modules.safety.clear_tank import Tank, TankSettings, filled_tank
from tests.support.tank_worlds import settings_of

Random = np.random.Generator
BISECTIONS = ledger.BISECTIONS


def random_settings(random: Random) -> TankSettings:
    n = int(random.integers(1, 8))
    compliance = np.where(random.random(n) < 0.3, 0.0, random.uniform(1e-3, 5e-3, n))
    error = random.choice([0.0, 1e-4, 1e-3]) * random.uniform(0.5, 1.0, n)
    return settings_of(
        n,
        delay=int(random.integers(0, 4)),
        hold=0.002 * int(random.integers(1, 4)),
        compliance=compliance,
        speed_bound=random.uniform(0.5, 4.0, n),
        sensing_error=error,
        sensing_deviation=0.2 * error if random.random() < 0.5 else None,
        initial=float(random.uniform(0.6, 4.0)),
        recovery_time=float(random.choice([0.001, 0.05, 0.5])),
    )


def flat(tank: Tank) -> np.ndarray:
    return np.concatenate([np.ravel(np.asarray(getattr(tank, entry.name), float)) for entry in fields(Tank)])


@dataclass
class Pair:
    """One life, kept in both books."""

    settings: TankSettings
    clear: Tank
    book: Book
    seen: set[str] = field(default_factory=set)

    def agree(self) -> None:
        found = compiled_ledger.record(self.book, self.clear.overspeed)
        wrong = np.abs(flat(found) - flat(self.clear)) > 1e-10 * (1.0 + np.abs(flat(self.clear)))
        assert not wrong.any(), (found, self.clear)

    def parts(self, *names: str) -> list[np.ndarray]:
        return [getattr(self.book, name) for name in names]

    def measure(self, q: np.ndarray, effort: np.ndarray, potential: float) -> None:
        self.clear = ledger.measure(self.clear, self.settings, q, effort, potential)
        first = compiled_ledger.measure(*self.book, q, effort, potential)
        n = q.size
        assert first == (self.clear.overspeed[0] if self.clear.overspeed else n)
        self.seen |= {"overspeed"} if self.clear.overspeed else set()

    def missed(self) -> None:
        self.clear = ledger.missed(self.clear, self.settings)
        names = ("scalars", "constants", "speed_bound", "pending")
        compiled_ledger.missed(*self.parts(*names))

    def grant(self, potential_at: Callable[[float], float]) -> float:
        self.clear, part = ledger.grant(self.clear, self.settings, potential_at)
        assert part == self._grant_compiled(potential_at)
        self.seen |= {"refused"} if part == 0.0 else {"part"} if part < 1.0 else {"whole"}
        return part

    def _grant_compiled(self, potential_at: Callable[[float], float]) -> float:
        """The bisection of ``compiled_cycle``, from the compiled ledger's three pieces."""
        scalars, constants = self.book.scalars, self.book.constants
        budget = compiled_ledger.budget(scalars, constants)
        part, granted, refused, kept = 1.0, 0.0, 1.0, float(scalars[POTENTIAL])
        for _ in range(BISECTIONS + 1):
            potential = potential_at(part)
            if compiled_ledger.change_cost(scalars, potential) <= budget:
                granted, kept = part, potential
            else:
                refused = part
            if granted == 1.0:
                break
            part = 0.5 * (granted + refused)
        if granted == 0.0:
            scalars[SHORT] = 1.0
        compiled_ledger.take_change(scalars, constants, kept)
        return granted

    def settle(self) -> None:
        before = self.clear.spring_scale
        self.clear = ledger.settle(self.clear, self.settings)
        compiled_ledger.settle(*self.parts("scalars", "constants", "applied", "sensing_error"))
        after = self.clear.spring_scale
        self.seen |= {"relaxed"} if after < before else {"tightened"} if after > before else set()

    def pay(self, effort: np.ndarray, *, stopping: bool) -> np.ndarray:
        self.clear, granted = ledger.pay(self.clear, self.settings, effort, stopping)
        given = effort.copy()
        names = ("scalars", "constants", "speed_bound", "sensing_error", "applied", "pending")
        scale = compiled_ledger.pay(*self.parts(*names), given, stopping)
        assert np.allclose(given, granted, rtol=1e-10, atol=1e-12)
        self.seen |= {"scaled"} if scale < 1.0 else {"paid"}
        return granted

    def stop(self) -> None:
        """Relaxes every spring, as a stop does: their energy goes back to the tank."""
        clear = self.clear
        self.clear = replace(clear, level=clear.level + clear.declared, potential=0.0, spring_scale=0.0)
        scalars = self.book.scalars
        scalars[LEVEL] += scalars[SCALE] * scalars[POTENTIAL]
        scalars[SCALE], scalars[POTENTIAL] = 0.0, 0.0


def live(seed: int, cycles: int = 150) -> set[str]:
    """A random life: measured and missed cycles, moved springs, wanted torques, at last a stop."""
    random = np.random.default_rng(seed)
    s = random_settings(random)
    n = s.speed_bound.size
    q, effort = random.normal(size=n), random.normal(size=n)
    tank = filled_tank(s, q, effort, float(random.uniform(0.0, 2.0)))
    pair = Pair(s, tank, compiled_ledger.open_book(tank, s))
    pair.agree()
    size, winding = 10.0 ** random.uniform(-1.0, 1.5), float(random.uniform(0.0, 0.3))
    stop_at = int(cycles * random.uniform(0.6, 1.0))
    for k in range(cycles):
        stopped = k >= stop_at
        if k == stop_at:
            pair.stop()
        if k and random.random() < 0.15:
            pair.missed()
            pair.agree()
            continue
        if k:
            q = q + random.uniform(-1.05, 1.05, n) * s.speed_bound * s.period * random.random()
            # An environment that winds the springs or lets them go.
            wound = pair.clear.potential + winding * random.normal()
            potential = 0.0 if stopped else max(0.0, wound)
            pair.measure(q, effort + 0.1 * random.normal(size=n), potential)
            pair.agree()
        if not stopped:
            here, there = pair.clear.potential, float(random.uniform(0.0, 3.0)) * (random.random() < 0.5)
            pair.grant(lambda part, a=here, b=there: a + part**2 * (b - a))
            pair.agree()
            pair.settle()
            pair.agree()
        pair.pay(size * random.normal(size=n), stopping=stopped)
        pair.agree()
    return pair.seen


@pytest.mark.parametrize("block", range(4))
def test_both_ledgers_agree_over_random_lives(block: int) -> None:
    seen: set[str] = set()
    for seed in range(15):
        seen |= live(100 * block + seed)
    assert seen == {
        "overspeed", "refused", "part", "whole", "relaxed", "tightened", "scaled", "paid",
    }  # fmt: skip


def test_a_book_is_the_tank_it_was_opened_with() -> None:
    random = np.random.default_rng(5)
    s = random_settings(random)
    n = s.speed_bound.size
    tank = replace(
        filled_tank(s, random.normal(size=n), random.normal(size=n), 0.7), missed=2, short=True, variance=1e-9
    )
    pair = Pair(s, tank, compiled_ledger.open_book(tank, s))
    pair.agree()
