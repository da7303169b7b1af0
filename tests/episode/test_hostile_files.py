# SPDX-License-Identifier: BSD-3-Clause
"""Recordings, logs and maps that were made to harm: special files, metadata of another kind, numbers without bound."""

import json
import os
import socket
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.episode import exact_numbers
from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.episode.metadata import METADATA_KEY
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_picture import write_picture
from impedance_modules.errors import BadInput
from impedance_modules.spec.document import read_document
from impedance_modules.strict_json import DEEPEST, parse_json
from tests.support.commands import refusal
from tests.support.import_logs import POSITION, base_map, map_of, motion, table_log, write_map
from tests.support.log_metadata import log_metadata

ROWS = 200


def columns() -> dict[str, np.ndarray]:
    time, q, v = motion(ROWS)
    numbers = {f"position.{name}": q[:, i] for i, name in enumerate("ab")}
    return {"time": time, **numbers, **{f"effort.{name}": v[:, i] for i, name in enumerate("ab")}}


def by_hand(path: Path, metadata: str | bytes, **replaced: object) -> Path:
    """An episode as a stock writer makes it, with any text for metadata."""
    table = pa.table({**columns(), **replaced})
    raw = metadata.encode() if isinstance(metadata, str) else metadata
    pq.write_table(table.replace_schema_metadata({METADATA_KEY.encode(): raw}), path)
    return path


def special_files(folder: Path) -> list[tuple[Path, str]]:
    os.mkfifo(folder / "fifo")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "socket"))
    return [
        (Path("/dev/zero"), "is a device"),
        (folder / "fifo", "is a FIFO"),
        (folder / "socket", "is a socket"),
    ]


def test_special_files_are_refused_by_every_reader_at_once(tmp_path: Path) -> None:
    log, mapping = table_log(tmp_path / "log.csv"), write_map(tmp_path / "map.yaml", base_map())
    for path, words in special_files(tmp_path):
        for words_of_verb in (
            ("import", path, "--out", tmp_path / "out"),
            ("import", path, "--map", mapping, "--out", tmp_path / "out"),
            ("import", log, "--map", path, "--out", tmp_path / "out"),
            ("replay", path, "--verify"),
            ("diagnose", path, "--urdf", path),
            ("check", path),
            ("run", "soft-hold", "--effects", path, "--out", tmp_path / "run"),
            ("map", path, "--out", tmp_path / "out"),
            ("roughness", path),
            ("probe", path, "--robot", "baxter", "--out", tmp_path / "out"),
            ("sweep", path, "--vary", "a=0:1", "--out", tmp_path / "out"),
        ):
            assert words in refusal(*words_of_verb), words_of_verb
    assert not (tmp_path / "out").exists() and not (tmp_path / "run").exists()


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat", ".npz", ".bag", ".mcap", ".db3"])
def test_a_fifo_is_refused_whatever_it_is_called(tmp_path: Path, suffix: str) -> None:
    os.mkfifo(tmp_path / f"log{suffix}")
    mapping = write_map(tmp_path / "map.yaml", base_map())
    for map_path in (None, mapping):
        with pytest.raises(BadInput, match="is a FIFO"):
            import_sources([tmp_path / f"log{suffix}"], map_path, None, tmp_path / "out")


def test_a_fifo_in_the_folder_of_a_bag_or_named_by_a_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    os.mkfifo(tmp_path / "bag" / "metadata.yaml")
    assert "is a FIFO" in refusal("import", tmp_path / "bag", "--out", tmp_path / "out")
    data = write_map(tmp_path / "map.yaml", base_map(urdf="/dev/zero"))
    log = table_log(tmp_path / "log.csv")
    assert "is a device" in refusal("import", log, "--map", data, "--out", tmp_path / "out")


# --- metadata --------------------------------------------------------------------------------------------

GOOD = log_metadata()
WRONG = [
    ("rate", "x"), ("rate", -1), ("rate", True), ("rate", 10**19), ("scale", [1]), ("scale", 0), ("seed", -1),
    ("arm", 3), ("arms", "right"), ("arms", [1]), ("limbs", ["a"]), ("limbs", {"a": "b"}), ("limbs", {"a": [[]]}),
    ("effort_max", {"a": 0}), ("effort_max", {"a": "1"}), ("effort_max", [1, 2]), ("tank", {"floor": "low"}),
    ("tank", 5), ("versions", {"numpy": 2}), ("versions", ["numpy"]), ("acting", {"a": 1}), ("acting", [None]),
    ("joint_origins", {"a": [[0, 0], [0, 0, 0]]}), ("joint_origins", [1]), ("effects", ["friction"]),
    ("task_path", 7), ("complete", "yes"), ("saved", True), ("saved", {}), ("saved", {"first_row": "0"}),
    ("imported", 5), ("segment", {"began": 0}), ("kept_every", 3), ("backend", {"sim": 1}),
    ("episode", "a\x1b[2Jb"), ("episode", "a\nb"), ("robot", ["baxter"]), ("episode", "n" * 1000),
    ("repeat_of", 4), ("task", {"format": 1}), ("gravity_compensation", ["robot"]), ("format", "1"),
]  # fmt: skip


@pytest.mark.parametrize(("key", "value"), WRONG, ids=[f"{key}-{str(value)[:20]!r}" for key, value in WRONG])
def test_metadata_of_another_kind_are_refused_with_what_is_valid(
    tmp_path: Path, key: str, value: object
) -> None:
    path = by_hand(tmp_path / "log.parquet", json.dumps({**GOOD, key: value}))
    with pytest.raises(BadInput) as caught:
        read_episode(path)
    assert f"metadata '{key}' is" in str(caught.value) and "(valid: " in str(caught.value)
    assert refusal("import", path, "--out", tmp_path / "out") == str(caught.value)


@pytest.mark.parametrize("key", ["format", "robot", "episode", "gravity_compensation", "effort_source"])
def test_metadata_that_lack_a_key_are_refused(tmp_path: Path, key: str) -> None:
    path = by_hand(tmp_path / "log.parquet", json.dumps({k: v for k, v in GOOD.items() if k != key}))
    with pytest.raises(BadInput, match=f"metadata '{key}' is None"):
        read_episode(path)


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2]", "3", "null", "{", "", "{\"a\": NaN}", "{\"a\": -Infinity}", "{\"a\": 1e999}",
        "{\"a\": " + "9" * 5000 + "}", "[" * 100_000, "{\"a\":" * 50_000, "\xff\xfe", "[" * 200 + "]" * 200,
        b"\xff\xfe\x00\x01", b"\x80\x81",
    ],
    ids=range(15),
)  # fmt: skip
def test_metadata_that_are_no_json_object_are_refused(tmp_path: Path, text: str | bytes) -> None:
    with pytest.raises(BadInput, match="metadata 'impedance_modules'"):
        read_episode(by_hand(tmp_path / "log.parquet", text))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=8,
)
KEYS = sorted({key for key, _ in WRONG} | set(GOOD))


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(KEYS), JSON, max_size=3))
def test_any_metadata_are_used_by_picture_and_copy_or_refused(tmp_path_factory, changes) -> None:
    folder = tmp_path_factory.mktemp("any")
    path = by_hand(folder / "log.parquet", json.dumps({**GOOD, **changes}))
    try:
        episode = read_episode(path)
    except BadInput:
        return
    write_picture(episode, folder / "picture.png")
    import_sources([path], None, None, folder / "out")


def test_json_is_read_as_the_standard_says() -> None:
    assert parse_json('{"a": [1, 2.5, "x", null, true, 18446744073709551615]}') == {
        "a": [1, 2.5, "x", None, True, (1 << 64) - 1]
    }
    assert parse_json("[" * DEEPEST + "]" * DEEPEST) is not None
    for text in ("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), "NaN", "1e400", str(1 << 64)):
        with pytest.raises(ValueError, match=r"deep|finite|double|64 bits"):
            parse_json(text)


# --- numbers ---------------------------------------------------------------------------------------------


def test_whole_numbers_that_a_double_rounds_are_refused(tmp_path: Path) -> None:
    stamps = np.int64(1_700_000_000_000_000_001) + np.arange(ROWS, dtype=np.int64) * 10_000_000
    whole = by_hand(tmp_path / "log.parquet", json.dumps(GOOD), time=stamps)
    for read in (lambda: read_episode(whole), lambda: import_sources([whole], None, None, tmp_path / "out")):
        with pytest.raises(BadInput, match=r"column 'time' holds whole numbers beyond 2\^53"):
            read()
    np.savez(tmp_path / "log.npz", t=stamps, q=np.column_stack(motion(ROWS)[1:2]))
    time = {"column": "t", "unit": "ns"}
    data = write_map(
        tmp_path / "map.yaml", map_of({"time": time, "position": {**POSITION, "columns": "q[{index}]"}})
    )
    with pytest.raises(BadInput, match=r"column 't' holds whole numbers beyond 2\^53"):
        import_sources([tmp_path / "log.npz"], data, None, tmp_path / "out")
    exact = by_hand(tmp_path / "exact.parquet", json.dumps(GOOD), time=np.arange(ROWS, dtype=np.int64))
    assert np.array_equal(read_episode(exact).time, np.arange(ROWS))


def test_a_file_that_says_that_it_is_larger_than_it_is_takes_no_memory(tmp_path: Path) -> None:
    np.savez(tmp_path / "good.npz", q=np.zeros((10, 2)))
    with zipfile.ZipFile(tmp_path / "good.npz") as good, zipfile.ZipFile(tmp_path / "log.npz", "w") as bad:
        bad.writestr("q.npy", good.read("q.npy").replace(b"(10, 2)", b"(9999999999, 9)"))
    data = write_map(
        tmp_path / "map.yaml", map_of({"position": {**POSITION, "columns": "q[{index}]"}}, rate=100)
    )
    with pytest.raises(BadInput, match="says that it is larger than it is"):
        import_sources([tmp_path / "log.npz"], data, None, tmp_path / "out")


def test_a_recording_of_more_rows_than_fit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = by_hand(tmp_path / "log.parquet", json.dumps(GOOD))
    monkeypatch.setattr(exact_numbers, "MOST_ROWS", ROWS - 1)
    for read in (lambda: read_episode(path), lambda: import_sources([path], None, None, tmp_path / "out")):
        with pytest.raises(BadInput, match=f"{ROWS} rows"):
            read()


def test_a_sweep_of_more_runs_than_anybody_has_time_for_is_refused_before_it_is_written_out(
    tmp_path: Path,
) -> None:
    words = (
        "sweep",
        "soft-hold",
        "--vary",
        "safety.tank.initial=1:2:999999999999",
        "--out",
        tmp_path / "out",
    )
    assert "999999999999 runs are too many" in refusal(*words)
    assert "not a path with a range" in refusal(
        "sweep", "soft-hold", "--vary", "a=-1e308:1e308", "--out", tmp_path
    )


def test_a_document_says_what_it_could_not_read(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be read"):
        read_document(tmp_path / ("n" * 300))
