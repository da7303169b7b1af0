# SPDX-License-Identifier: BSD-3-Clause
"""Writes a whole episode at once, for recordings that exist already (imports, generators, tests)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from impedance_modules.episode.columns import PHASE, parse_columns
from impedance_modules.episode.metadata import check_metadata
from impedance_modules.episode.file_format import episode_schema, is_required, write_merged
from impedance_modules.errors import BadInput


def write_episode(
    path: Path,
    columns: Mapping[str, NDArray[np.float64] | Sequence[str | None]],
    metadata: Mapping[str, Any],
) -> Path:
    """Writes one Parquet file, whole or not at all.

    Args:
        path: Of the file; its directory exists.
        columns: Name -> (samples,) numbers; ``phase`` -> texts. NaN means no value in a column that need not
            have one.
        metadata: From `episode_metadata`.

    Raises:
        BadInput: Columns or metadata that no episode may have, or columns of different lengths.
    """
    place = str(path)
    names = tuple(columns)
    parse_columns(names, place)
    check_metadata(metadata, place, has_effort=any(name.startswith("effort.") for name in names))
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1:
        raise BadInput(f"{place}: columns of {sorted(lengths)} samples (valid: all of one length)")
    schema = episode_schema(names, {"complete": True, **metadata}, place)
    arrays = [_array(name, columns[name]) for name in names]
    write_merged(Path(path), iter([pa.Table.from_arrays(arrays, schema=schema)]), schema)
    return Path(path)


def _array(name: str, values: NDArray[np.float64] | Sequence[str | None]) -> pa.Array:
    if name == PHASE:
        return pa.array(values, pa.string()).dictionary_encode()
    return pa.array(np.asarray(values, dtype=np.float64), from_pandas=not is_required(name))
