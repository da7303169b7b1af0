# SPDX-License-Identifier: BSD-3-Clause
"""A seeded sample of the tests marked ``long``: each group of them keeps a share, and at least one test."""

import hashlib
import math
from collections import defaultdict
from collections.abc import Iterable


def sample_of(nodes: Iterable[str], share: float, seed: int) -> set[str]:
    """Chooses the tests that run.

    The parametrisations of one test are a group. Tests that have none are a group with those of the same folder.

    Args:
        nodes: Names of all tests marked ``long``, as pytest writes them: ``tests/a/test_b.py::test_c[2]``.
        share: Part of each group that is kept, in (0, 1].
        seed: Whatever it is, a group keeps at least one test; the choice depends on names and seed alone.
    """
    groups: dict[str, list[str]] = defaultdict(list)
    for node in nodes:
        test, bracket, _ = node.partition("[")
        groups[test if bracket else test.partition("::")[0].rpartition("/")[0]].append(node)
    kept = set()
    for group in groups.values():
        group.sort(key=lambda node: hashlib.sha256(f"{seed} {node}".encode()).digest())
        kept.update(group[: max(1, math.ceil(share * len(group) - 1e-9))])
    return kept
