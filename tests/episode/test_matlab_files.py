# SPDX-License-Identifier: BSD-3-Clause
"""MATLAB's files are read as scipy reads them, as far as they hold real numbers; a damaged one is refused."""

import io
import zlib

import numpy as np
import pytest
import scipy.io

from impedance_modules.episode.imports.matlab_file import NewerVersionError, read_variables

TYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def written(variables: dict[str, object], **how: object) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, variables, **how)
    return stream.getvalue()


def numbers(draw: np.random.Generator) -> np.ndarray:
    shape = tuple(draw.integers(1, 6, draw.choice([1, 2, 2, 2, 3])))
    return (100 * draw.normal(size=shape)).astype(draw.choice(TYPES))


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("packed", [False, True])
def test_numbers_come_back_as_scipy_reads_them(seed: int, packed: bool) -> None:
    draw = np.random.default_rng(seed)
    plain = {f"v{index}": numbers(draw) for index in range(4)}
    inner = {"deep": numbers(draw), "word": "text"}
    more = {
        "s": {"a": numbers(draw), "inner": inner, "none": np.zeros((0, 0))},
        "c": np.array([{}, 1], dtype=object),
    }
    raw = written({**plain, **more, "t": "text", "z": np.array([1j])}, do_compression=packed)
    ours, theirs = (
        read_variables(raw),
        scipy.io.loadmat(io.BytesIO(raw), squeeze_me=True, struct_as_record=False),
    )
    assert set(ours) == {*plain, "s"}
    for name in plain:
        assert np.array_equal(ours[name], theirs[name])
        assert ours[name].ndim == 0 or ours[name].dtype == theirs[name].dtype  # a single number is Python's
    assert np.array_equal(ours["s"]["a"], theirs["s"].a)
    assert np.array_equal(ours["s"]["inner"]["deep"], theirs["s"].inner.deep)


@pytest.mark.parametrize("seed", range(10))
def test_version_4_comes_back(seed: int) -> None:
    draw = np.random.default_rng(seed)
    plain = {name: draw.normal(size=(draw.integers(1, 9), 3)) for name in "ab"}
    raw = written({**plain, "t": "text"}, format="4")
    ours = read_variables(raw)
    assert set(ours) == set(plain)
    assert all(np.array_equal(ours[name], np.squeeze(plain[name])) for name in plain)


def test_a_file_cut_off_anywhere_is_refused() -> None:
    for packed in (False, True):
        raw = written({"q": np.arange(20.0), "s": {"a": np.arange(3.0)}}, do_compression=packed)
        whole = set(read_variables(raw))
        for stop in range(0, len(raw), 3):
            try:
                assert set(read_variables(raw[:stop])) < whole
            except (ValueError, zlib.error) as error:
                assert str(error)


def test_version_7_3_says_so() -> None:
    with pytest.raises(NewerVersionError, match=r"7\.3"):
        read_variables(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
