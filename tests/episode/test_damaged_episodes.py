# SPDX-License-Identifier: BSD-3-Clause
"""Damage is found when a recording is read, and what is intact beside it can be saved."""

import io
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from impedance_modules.episode import file_format
from impedance_modules.episode.damage import survey
from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import part_paths
from impedance_modules.episode.sealed_parquet import find_blocks
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import BadInput
from tests.support.commands import invoke, refusal
from tests.support.log_metadata import log_metadata

BLOCK, ROWS = 100, 250
NAMES = ["time", "position.a", "effort.a", "tank", "phase"]
METADATA = log_metadata(task="format: 1\nname: press\n")


def numbers() -> np.ndarray:
    rows = np.random.default_rng(3).normal(size=(ROWS, 4))
    rows[:, 0] = np.arange(ROWS) * 1e-3
    rows[::7, 3] = np.nan
    return rows


def phase_of(row: int) -> str:
    return "lower" if row < 120 else "slide"


@pytest.fixture
def whole(tmp_path, monkeypatch) -> Path:
    """A file of three blocks."""
    monkeypatch.setattr(file_format, "ROWS_PER_GROUP", BLOCK)
    columns = dict(zip(NAMES, numbers().T, strict=False))
    columns["phase"] = [phase_of(row) for row in range(ROWS)]
    return write_episode(tmp_path / "whole.parquet", columns, METADATA)


@pytest.fixture
def parts(tmp_path) -> Path:
    """A folder as a kill leaves it, in parts of about 50 rows."""
    live, dead = tmp_path / "live", tmp_path / "dead"
    with EpisodeWriter(live, NAMES, METADATA, wait_for_disk=True) as out:
        for row, values in enumerate(numbers()):
            out.append(values, phase_of(row))
            if row % 50 == 49:
                out.background.wake()
                while out._ring.released <= row:
                    pass
        shutil.copytree(live, dead, ignore=shutil.ignore_patterns(".*"))
    assert len(part_paths(dead)) >= 5
    return dead


def same_rows(episode, first: int, count: int) -> None:
    """The episode holds these rows of the recording, bit by bit."""
    expected = numbers()[first : first + count]
    found = np.column_stack(
        [episode.time, episode.position["a"], episode.effort["a"], np.asarray(episode.tank)]
    )
    assert np.array_equal(found, expected, equal_nan=True)
    assert list(episode.phase) == [phase_of(row) for row in range(first, first + count)]


def flip(path: Path, rng: np.random.Generator) -> None:
    """Turns one bit of a file."""
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    path.write_bytes(content)


def assert_intact_rows_are_true(place: Path) -> int:
    """Everything that a survey calls intact is what was recorded; returns how many rows that is."""
    found = survey(place)
    expected = numbers()
    for stretch in found.stretches:
        for piece in stretch:
            table = pa.concat_tables(piece.tables())
            first = round(table["time"][0].as_py() * 1e3)
            assert piece.first in (None, first)
            for column, name in enumerate(NAMES[:4]):
                values = table[name].to_numpy()
                assert np.array_equal(values, expected[first : first + len(table), column], equal_nan=True)
    return found.intact_rows


@pytest.mark.parametrize("seed", range(4))
def test_one_wrong_bit_is_found_or_harmless(whole, seed):
    rng, content, refused = np.random.default_rng(seed), whole.read_bytes(), 0
    for _ in range(25):
        whole.write_bytes(content)
        flip(whole, rng)
        try:
            episode = read_episode(whole)
        except BadInput as error:
            refused += 1
            assert "is damaged: whole.parquet" in str(error)
            assert assert_intact_rows_are_true(whole) >= ROWS - BLOCK
        else:
            same_rows(episode, 0, ROWS)
            assert episode.metadata == {**METADATA, "complete": True}
    assert refused >= 10


@pytest.mark.parametrize("seed", range(10))
def test_one_wrong_bit_in_a_part_costs_at_most_that_part(parts, seed):
    rng = np.random.default_rng(seed)
    bad = part_paths(parts)[rng.integers(len(part_paths(parts)))]
    lost = pq.read_metadata(bad).num_rows
    flip(bad, rng)
    names = [path.name for path in part_paths(parts)]
    try:
        same_rows(read_episode(parts), 0, ROWS)
    except BadInput as error:
        assert f"is damaged: {bad.name}" in str(error)
        assert [path.name for path in part_paths(parts)] == names
        assert assert_intact_rows_are_true(parts) >= ROWS - lost


@pytest.mark.parametrize("seed", range(12))
def test_of_a_file_cut_off_anywhere_all_blocks_before_the_cut_are_saved(whole, tmp_path, seed):
    ends = [stop for _, stop in find_blocks(whole)]
    assert len(ends) == 3
    content = whole.read_bytes()
    cut = int(np.random.default_rng(seed).integers(1, len(content)))
    whole.write_bytes(content[:cut])
    blocks = sum(stop <= cut for stop in ends)
    with pytest.raises(BadInput, match="is damaged") as error:
        read_episode(whole)
    if not blocks:
        assert "nothing of it can be saved" in str(error.value)
        assert "nothing of it can be saved" in refusal("import", whole, "--out", tmp_path / "saved")
        assert not (tmp_path / "saved").exists()
        return
    rows = min(blocks * BLOCK, ROWS)
    assert f"{rows} rows are intact, {(rows - 1) * 1e-3:.6g} s" in str(error.value)
    said = invoke("import", whole, "--out", tmp_path / "saved").output
    assert f"rows 0 to {rows - 1} of it" in said and "not a whole Parquet file" in said
    saved = read_episode(tmp_path / "saved" / "whole.parquet")
    same_rows(saved, 0, rows)
    assert not saved.complete and saved.metadata["saved"] == {"first_row": 0}


def test_around_a_damaged_block_two_stretches_are_saved(whole, tmp_path):
    (_, (start, stop), _) = find_blocks(whole)
    content = bytearray(whole.read_bytes())
    content[start + (stop - start) // 4] ^= 1
    whole.write_bytes(content)
    with pytest.raises(
        BadInput, match=r"rows 100 to 199: .*150 of 250 rows are intact, 0.148 s in 2 stretches"
    ):
        read_episode(whole)
    invoke("import", whole, "--out", tmp_path / "saved")
    same_rows(read_episode(tmp_path / "saved" / "whole-1.parquet"), 0, 100)
    later = tmp_path / "saved" / "whole-2.parquet"
    same_rows(read_episode(later), 200, 50)
    assert "from the middle of a damaged recording" in refusal("replay", later, "--verify")
    assert whole.read_bytes() == bytes(content)


def test_a_part_that_is_missing_is_a_hole_and_not_a_shorter_recording(parts, tmp_path):
    gone = part_paths(parts)[2]
    first = sum(pq.read_metadata(path).num_rows for path in part_paths(parts)[:2])
    count = pq.read_metadata(gone).num_rows
    gone.unlink()
    with pytest.raises(BadInput, match=r"part-00003.parquet does not follow on part 1"):
        read_episode(parts)
    invoke("import", parts, "--out", tmp_path / "saved")
    same_rows(read_episode(tmp_path / "saved" / "dead-1.parquet"), 0, first)
    same_rows(read_episode(tmp_path / "saved" / "dead-2.parquet"), first + count, ROWS - first - count)


def test_a_file_between_parts_that_is_no_part_is_left_alone(parts):
    (parts / "episode.part-notes.parquet").write_text("mine")
    same_rows(read_episode(parts), 0, ROWS)
    assert (parts / "episode.part-notes.parquet").read_text() == "mine"


def test_a_stock_reader_reads_the_file_and_each_block_and_sees_damaged_pages(whole):
    table = pq.read_table(whole, page_checksum_verification=True)
    content = whole.read_bytes()
    rows = 0
    for start, stop in find_blocks(whole):
        block = pq.read_table(io.BytesIO(content[start:stop]), page_checksum_verification=True)
        assert block.equals(table.slice(rows, len(block)))
        rows += len(block)
    assert rows == len(table) == ROWS
    page = pq.read_metadata(whole).row_group(0).column(1)
    middle = page.data_page_offset + page.total_compressed_size - 10
    damaged = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    with pytest.raises(OSError, match="CRC checksum"):
        pq.read_table(io.BytesIO(damaged), page_checksum_verification=True)


def test_files_without_a_seal_are_read(whole, tmp_path):
    table = pq.read_table(whole)
    pq.write_table(table, tmp_path / "stock.parquet")
    same_rows(read_episode(tmp_path / "stock.parquet"), 0, ROWS)
    assert survey(tmp_path / "stock.parquet").problems == ()
