# SPDX-License-Identifier: BSD-3-Clause
"""Of the search for inputs that break a reader: every input that once did, and a seeded sample of new ones."""

import os
import random
import shutil
from pathlib import Path

import pytest

from tests.fuzz import __main__ as search
from tests.fuzz import judge as judging
from tests.fuzz.judge import judge
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import READERS, Reader

SAMPLE = 40
"""New inputs of each reader."""


def test_every_reader_can_be_searched() -> None:
    assert set(search.NAMES) == set(READERS)


@pytest.mark.parametrize("name", READERS)
def test_inputs_that_once_broke_a_reader_are_read_or_refused(name: str) -> None:
    reader = READERS[name]
    for data in reader.seeds():
        verdict = judge(reader, data)
        assert verdict.ending in ("read", "refused"), verdict


@pytest.mark.parametrize("name", READERS)
def test_changed_inputs_are_read_or_refused(name: str) -> None:
    reader, draw = READERS[name], random.Random(f"sample of {name}")
    seeds = reader.seeds()
    for _ in range(SAMPLE):
        data = mutated(draw.choice(seeds), seeds, draw, text=reader.text)
        verdict = judge(reader, data)
        assert verdict.ending in ("read", "refused"), (verdict, data)


def reading(action) -> Reader:
    return Reader("own", lambda _: ".txt", action)


def raise_key_error(path: Path, out: Path) -> None:
    raise KeyError("x")


def write_outside(path: Path, out: Path) -> None:
    (Path.cwd() / "outside").write_text("x")


def hang(path: Path, out: Path) -> None:
    while True:
        pass


def fill_memory(path: Path, out: Path) -> None:
    assert len(b"x" * (judging.memory() + (64 << 20)))


@pytest.mark.parametrize(
    ("action", "ending"),
    [
        (lambda path, out: (out / "kept").write_text("x"), "read"),
        (raise_key_error, "exception"),
        (write_outside, "outside"),
        (lambda path, out: os.system("true"), "outside"),
        (hang, "hang"),
        (fill_memory, "memory"),
    ],
    ids=["fine", "exception", "outside", "program", "hang", "memory"],
)
def test_what_is_looked_for_is_found(action, ending, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(judging, "LONGEST", 0.3 if ending == "hang" else 60.0)
    monkeypatch.setattr(judging, "MOST_MEMORY", 16 << 20)
    assert judge(reading(action), b"x").ending == ending
    shutil.rmtree(tmp_path)
