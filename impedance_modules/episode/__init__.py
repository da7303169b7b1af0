# SPDX-License-Identifier: BSD-3-Clause
"""The recording of a run: Parquet written as the run goes, read back as numbers, seen in rerun.

Rooms: ``columns`` (names), ``metadata`` (who, what, which sensor), ``writer`` and ``parts`` (a kill -9 loses
    at
most the last second), ``reader`` and ``data`` (an `Episode`), ``scene``, ``view``, ``recording``, ``layout``
and ``viewer`` (rerun), ``picture`` (one still image). rerun and matplotlib are imported when first used.
"""
