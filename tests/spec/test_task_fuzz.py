# SPDX-License-Identifier: BSD-3-Clause
"""Ten thousand mutated task files: each is a TaskSpec or a located, readable complaint, never a traceback."""

import copy
import functools
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import TaskSpec
from impedance_modules.spec.task_reader import check_task, read_task
from tests.support.paths import TESTS

DATA = TESTS / "data"
TEXTS = tuple((DATA / name).read_text() for name in ("press-box.yaml", "every-key.yaml"))
PARSED = tuple(yaml.safe_load(text) for text in TEXTS)
TOKEN = re.compile(r"[A-Za-z_][\w.-]*|[-+]?[0-9][\w.+-]*|[^\s\w]|\n *")
SHARDS = 4
FILES_PER_SHARD = 2_500

cached_robot = functools.lru_cache(read_robot)

VALUES = (
    None, True, False, 0, 1, -1, 45, 1e9, -1e-9, 0.7, 10**14, "", "x", "a" * 300, "1e3", "on",
    "baxster", "../..",
    "right", "left", "object", "right.hand", "left.elbow", "world", "torso", "right_hand", "head_pan",
    "box", "friction", "next", [], {}, [0], [[]], [1, 2, 3], ["right", "right"],
    [[1] * 6] * 6, [[0] * 6] * 6, [[-1] * 6] * 6, {"": 1}, {"x": 1}, {"z": -5}, {"force": 3},
    {"sine": {"amplitude": 1, "frequency": 900}}, {"mirror": "left"}, {"mirror": {}},
    {"contact": {"target": "x"}}, {"reached": {"distance": 1, "angle": 1}},
)  # fmt: skip
WORDS = (
    "on", "1e3", ".nan", ".inf", "0x1", "010", "1:30", "~", "", "*a", "&a", "<<: ", "1e999", "9" * 20,
    "!!python/object:os.system ", "{", "}", "[", "]", ":", ": ", "- ", "-", ",", "#", "\t", "\n", "\n---\n",
    "'", '"', "|", ">", "%", "@", "? ", "\x00", "\x07", "\ufeff", "é", "\u2028", "\r", "   ",
    "right", "world", "z", "mirror",
)  # fmt: skip

where = st.integers(0, 10_000)
edits = st.lists(st.tuples(st.sampled_from(range(6)), where, where), min_size=1, max_size=3)


def nodes(data, parent=None, key=None):
    """Every place in plain data, as (parent, key)."""
    if parent is not None:
        yield parent, key
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for step, value in list(inner):
        yield from nodes(value, data, step)


def mutated_tree(base, changes):
    """Deletes, renames, duplicates and replaces nodes."""
    data = copy.deepcopy(PARSED[base])
    for kind, place, choice in changes:
        places = list(nodes(data))
        if not places:
            break
        parent, key = places[place % len(places)]
        value = VALUES[choice % len(VALUES)]
        if kind <= 1:
            parent[key] = copy.deepcopy(value)
        elif kind == 2:
            del parent[key]
        elif kind == 3 and isinstance(parent, dict):
            parent[f"{key}{choice % 10}" if choice % 2 else str(value)[:20]] = parent.pop(key)
        elif kind == 4:
            other, step = places[choice % len(places)]
            parent[key] = copy.deepcopy(other[step])
        elif isinstance(parent, list):
            parent.append(copy.deepcopy(parent[key]))
    return json.dumps(data)


def mutated_text(base, changes):
    """Deletes, duplicates, replaces and swaps words; cuts and doubles lines; scrambles characters."""
    text = TEXTS[base]
    for kind, place, choice in changes:
        tokens = [match.span() for match in TOKEN.finditer(text)]
        if not tokens:
            break
        start, end = tokens[place % len(tokens)]
        word = WORDS[choice % len(WORDS)]
        if kind == 0:
            text = text[:start] + word + text[end:]
        elif kind == 1:
            text = text[:start] + text[end:]
        elif kind == 2:
            text = text[:end] + word + text[end:]
        elif kind == 3:
            other = tokens[choice % len(tokens)]
            text = text[:start] + text[slice(*other)] + text[end:]
        elif kind == 4:
            lines = text.split("\n")
            i = place % len(lines)
            lines[i : i + 1] = [lines[i]] * (choice % 3)
            text = "\n".join(lines)
        else:
            text = text[:start] + chr(choice % 0x3000) + text[start + 1 :]
    return text


INTERNALS = re.compile(r"object at 0x|Traceback|<class|_ABSENT|ValidationError")


def judge(read):
    """Reads once; returns ``accepted`` or ``refused`` and fails on anything else."""
    try:
        task, _ = read()
    except BadFile as error:
        assert error.problems
        for problem in error.problems:
            assert problem.line >= 1 and problem.column >= 1 and problem.message
            assert not INTERNALS.search(str(problem)), problem
        return "refused"
    except BadInput as error:
        assert str(error)
        return "refused"
    assert isinstance(task, TaskSpec)
    assert 0 <= task.tank.floor < task.tank.initial <= task.tank.max
    for spring in (spring for arm in task.arms.values() for spring in arm.springs):
        assert np.isfinite(spring.stiffness).all()
        assert np.linalg.eigvalsh(spring.stiffness)[0] >= -1e-6
    return "accepted"


@pytest.mark.long
@pytest.mark.parametrize("shard", range(SHARDS))
def test_a_mutated_task_is_read_or_refused_with_a_place(shard):
    seen = {"accepted": 0, "refused": 0}
    how = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}

    @seed(shard)
    @settings(max_examples=FILES_PER_SHARD, **how)
    @given(st.integers(0, 1), st.booleans(), edits)
    def read_one(base, as_tree, changes):
        text = mutated_tree(base, changes) if as_tree else mutated_text(base, changes)
        seen[judge(lambda: check_task(parse_document(DATA / "mutant.yaml", text), cached_robot))] += 1

    read_one()
    assert sum(seen.values()) >= FILES_PER_SHARD
    assert min(seen.values()) > 20, seen


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 1), st.integers(0, 2**30), st.binary(max_size=4), st.integers(0, 3))
def test_a_file_with_scrambled_bytes_is_read_or_refused(base, place, raw, cut):
    whole = TEXTS[base].encode()
    i = place % len(whole)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scrambled.yaml"
        file.write_bytes(whole[:i] + raw + whole[i + cut :])
        judge(lambda: read_task(file, cached_robot))
