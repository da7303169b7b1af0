# SPDX-License-Identifier: BSD-3-Clause
"""Many runs of an experiment: kept in a folder, and not done again by the same program."""

import os
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from impedance_experiments import parallel_runs as many
from impedance_experiments.kept_results import read_result, write_result
from impedance_experiments.parallel_runs import carry_out_all
from impedance_experiments.terrain_slides import Slide, slide
from impedance_modules.errors import BadInput


@dataclass(frozen=True)
class Job:
    """A number to square; a file notes that it was done."""

    value: float
    weights: NDArray[np.float64]
    note: Path


def square(job: Job) -> float:
    job.note.write_text(job.note.read_text() + f"{job.value:g} " if job.note.exists() else f"{job.value:g} ")
    return float(job.value**2 * job.weights.sum())


def test_only_what_is_missing_is_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    note, kept = tmp_path / "note", tmp_path / "kept"
    kept.mkdir()
    jobs = [Job(float(i), np.array([1.0, float(i)]), note) for i in range(4)]
    said: list[int] = []
    assert carry_out_all(square, jobs[:2], kept, said.append) == [0.0, 2.0]
    assert carry_out_all(square, jobs, kept, said.append) == [0.0, 2.0, 12.0, 36.0]
    assert note.read_text() == "0 1 2 3 " and said == [1, 2, 3, 4]
    # Another weight is another job, though the value is the same; so is any job of another program.
    assert carry_out_all(square, [Job(3.0, np.array([1.0, 1.0]), note)], kept, said.append) == [18.0]
    many.program.cache_clear()
    monkeypatch.setattr(many, "program", lambda: "changed")
    assert carry_out_all(square, jobs[3:], kept, said.append) == [36.0]
    assert note.read_text() == "0 1 2 3 3 3 "


def test_many_are_done_by_several_processes_in_order(tmp_path: Path) -> None:
    found = carry_out_all(abs, [float(-i) for i in range(6)], tmp_path, lambda _count: None)
    assert found == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


@dataclass(frozen=True)
class Answer:
    """Everything that may be kept."""

    numbers: NDArray[np.float64]
    share: float
    words: tuple[tuple[float, str], ...]
    found: dict[str, float]
    nothing: None


def answer(seed: int) -> Answer:
    draw = np.random.default_rng(seed)
    numbers = draw.normal(size=(draw.integers(0, 4), 3)) * 10.0 ** draw.integers(-300, 300)
    return Answer(numbers, float(draw.normal()), ((float("inf"), "a"),), {"b": float(draw.normal())}, None)


def same(one: Answer, other: Answer) -> bool:
    rest = (one.share, one.words, one.found, one.nothing) == (
        other.share,
        other.words,
        other.found,
        other.nothing,
    )
    return rest and np.array_equal(one.numbers, other.numbers) and type(one) is type(other)


def test_results_come_back_bit_equal(tmp_path: Path) -> None:
    for seed in range(20):
        write_result(answer(seed), tmp_path / "kept.npz")
        assert same(read_result(answer, tmp_path / "kept.npz"), answer(seed))
    made = Slide(*(np.arange(3.0) for _ in range(5)), "why", ((1.5, "impact"),))
    write_result(made, tmp_path / "slide.npz")
    assert read_result(slide, tmp_path / "slide.npz").collisions == made.collisions


class Planted:
    """Writes a file as soon as it is unpickled."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[object, tuple[str, ...]]:
        return os.mkdir, (str(self.target),)


def test_a_planted_pickle_is_not_executed(tmp_path: Path) -> None:
    kept, harm = tmp_path / "kept", tmp_path / "harm"
    kept.mkdir()
    carry_out_all(abs, [-1.0], kept, lambda _: None)
    (place,) = kept.iterdir()
    array = np.array([Planted(harm)], dtype=object)
    for plant in (
        lambda: place.write_bytes(pickle.dumps(Planted(harm))),
        lambda: np.savez(place, tree=array),
        lambda: place.write_bytes(b""),
    ):
        plant()
        with np.testing.assert_raises_regex(BadInput, "no kept result"):
            carry_out_all(abs, [-1.0], kept, lambda _: None)
    assert not harm.exists()
    pickle.loads(pickle.dumps(Planted(harm)))
    assert harm.exists(), "the plant works where it is unpickled"
