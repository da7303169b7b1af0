# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that a replay cannot feed back: time in another unit, columns or metadata that are missing or wrong."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from impedance_modules.episode.metadata import METADATA_KEY
from impedance_modules.episode.run_folder import EPISODE
from tests.support.commands import invoke, refusal


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A short run."""
    folder = tmp_path_factory.mktemp("run")
    invoke("run", "soft-hold", "--duration", "0.05", "--out", folder / "run")
    return folder / "run" / EPISODE


def changed(run: Path, target: Path, columns=lambda table: table, **metadata: object) -> Path:
    """The run's episode by a stock writer, with other columns or metadata; None leaves a key out."""
    table = pq.read_table(run)
    said = {**json.loads(table.schema.metadata[METADATA_KEY.encode()]), **metadata}
    said = {key: value for key, value in said.items() if value is not None}
    pq.write_table(columns(table).replace_schema_metadata({METADATA_KEY: json.dumps(said)}), target)
    return target


def column(name: str, change):
    return lambda table: table.set_column(
        table.schema.names.index(name), name, [change(table[name].to_numpy())]
    )


CASES = [
    ({"columns": column("time", lambda time: time * 1e9)}, "(valid: time in seconds, without a gap"),
    ({"columns": column("time", lambda time: time - 1e300 * (time > 0.02))}, "(valid: time in seconds"),
    ({"columns": lambda table: table.drop_columns(["late"])}, "no column 'late'"),
    ({"columns": lambda table: table.append_column("missed", [np.full(len(table), 1e18)])}, "column 'missed' is 1e+18"),
    ({"columns": lambda table: table.append_column("missed", [np.full(len(table), np.nan)])}, "column 'missed' is nan"),
    ({"rate": None}, "metadata 'rate' is missing"),
    ({"scale": None}, "metadata 'scale' is missing"),
    ({"rate": 1e17}, "Hz"),
    ({"acting": [1.0]}, "'acting' has 1 torques"),
    ({"task_path": "/" + "n" * 5000 + "/task.yaml", "task": "format: 1"}, "task.yaml"),
    ({"task": "name: \ud800"}, "task.yaml"),
    ({"joint_origins": {"nobody": [[0, 0, 0], [0, 0, 0]]}}, "no joint 'nobody'"),
    ({"arm": "nobody"}, "nobody"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), CASES, ids=range(len(CASES)))
def test_a_recording_that_cannot_be_replayed_is_refused_at_once(run, tmp_path, change, words) -> None:
    assert words in refusal("replay", changed(run, tmp_path / "log.parquet", **change), "--verify")


def test_the_same_recording_as_it_was_is_verified(run: Path, tmp_path: Path) -> None:
    assert (
        "every torque bit-equal"
        in invoke("replay", changed(run, tmp_path / "log.parquet"), "--verify").output
    )
