# SPDX-License-Identifier: BSD-3-Clause
"""Packed chunks of ROS recordings, unpacked to a stated size at most.

A few bytes can unpack to gigabytes (bz2 packs zeros a million times). The library that reads recordings unpacks a chunk
whole, whatever it becomes; here its own table of unpackers gets ones that stop.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import lz4.frame
from rosbags.rosbag1 import reader as ros1
from rosbags.rosbag2 import storage_mcap as mcap

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LARGEST_CHUNK = 256_000_000
"""What a chunk may unpack to [bytes]. ROS packs 0.8 to 4 MB into one."""

UNPACKERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
"""Kind of packing -> makes what unpacks one stream."""


def unpack(kind: str, packed: bytes) -> bytes:
    """Unpacks a chunk of one or more streams.

    Raises:
        ValueError: It would become larger than ``LARGEST_CHUNK``, or ends early.
    """
    parts: list[bytes] = []
    left = LARGEST_CHUNK
    while packed:
        unpacker = UNPACKERS[kind]()
        parts.append(unpacker.decompress(packed, max_length=left + 1))
        left -= len(parts[-1])
        if left < 0:
            raise ValueError(f"a packed chunk is larger than {LARGEST_CHUNK / 1e6:.0f} MB")
        if not unpacker.eof:
            raise ValueError("a packed chunk ends early")
        packed = unpacker.unused_data or b""
    return b"".join(parts)


def bound_chunks() -> None:
    """Makes the library unpack with ``unpack``."""
    ros1.decompressors.update({kind: partial(unpack, kind) for kind in ("bz2", "lz4")})
    mcap.DECOMPRESSORS.update({kind: partial(_unpack_mcap, kind) for kind in ("lz4", "zstd")})


def _unpack_mcap(kind: str, packed: bytes, _size: int) -> bytes:
    """As ``unpack``; the library compares the size that the recording states."""
    return unpack(kind, packed)
