# SPDX-License-Identifier: BSD-3-Clause
"""Reading YAML: every value keeps its place, every trap is caught, no file can hang or break the reader."""

import os
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.document import LARGEST_FILE, parse_document, print_path, read_document
from impedance_modules.spec.yaml_tree import MOST_VALUES, read_plain

NAME = Path("task.yaml")

words = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "Zs"]), min_size=1, max_size=8)
keys = words.filter(
    lambda word: read_plain(word)[1] is None and word != "<<"
)  # PyYAML writes "08" without quotes
numbers = st.integers(-(10**14), 10**14) | st.floats(allow_nan=False, allow_infinity=False)


def branches(inner):
    return st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3)


values = st.recursive(st.none() | st.booleans() | numbers | keys, branches, max_leaves=12)
trees = st.dictionaries(keys, values, min_size=1, max_size=4)


def leaves(data, path=()):
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from leaves(value, (*path, key))
    else:
        yield path, data


@settings(max_examples=200, deadline=None)
@given(trees, st.sampled_from([True, False, None]))
def test_plain_yaml_reads_as_itself_and_every_leaf_keeps_its_place(data, flow):
    text = yaml.safe_dump(data, default_flow_style=flow, allow_unicode=True, sort_keys=False, width=10**6)
    document = parse_document(NAME, text)
    assert document.data == data == yaml.safe_load(text)
    assert document.yaml_problems == ()
    lines = text.split("\n")
    for path, value in leaves(data):
        problem = document.problem(path, "here")
        found = lines[problem.line - 1][problem.column - 1 :]
        if isinstance(value, str):
            assert found[0] in "'\"" or found.startswith(value), (path, problem)
        else:
            assert found.startswith(yaml.safe_dump(value).split("\n")[0]), (path, problem)


@settings(max_examples=300, deadline=None)
@example("0E0_0")
@example("1_0.5e-1_0")
@example(".1_0")
@given(st.text(alphabet="+-.0123456789eExXo_:,nNaAiIfFyYtTrRuUlLsS~ ", max_size=8).map(str.strip))
def test_a_word_is_read_as_every_yaml_reader_reads_it_or_refused(word):
    value, trap = read_plain(word)
    if trap is not None:
        return
    stock = yaml.safe_load(f"- {word}\n")[0] if plain_in_yaml(word) else word
    if isinstance(value, int | float):
        assert value == stock and type(value) is type(stock)
        assert isinstance(value, bool) or value == float(word)
    elif isinstance(value, str) and isinstance(stock, str):
        with pytest.raises(ValueError):
            float(word)


def plain_in_yaml(word):
    try:
        events = [e for e in yaml.parse(f"- {word}\n") if isinstance(e, yaml.ScalarEvent)]
    except yaml.YAMLError:
        return False
    return len(events) == 1 and events[0].value == word


@pytest.mark.parametrize("word", ["1e3", "1E3", "-2e-3", "1.5e3", ".5e1", "1e+3"])
def test_a_refused_exponent_comes_with_the_spelling_that_all_readers_share(word):
    value, trap = read_plain(word)
    spelling = trap.split("write ")[1]
    assert value == float(word) == yaml.safe_load(spelling)
    assert read_plain(spelling) == (float(word), None)


@pytest.mark.parametrize("depth", [9, 30])
def test_an_alias_bomb_is_refused_before_it_grows(depth):
    levels = [f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]" for i in range(depth)]
    text = "\n".join(["a0: &a0 [x, x, x, x, x, x, x, x, x]", *levels])
    with pytest.raises(BadFile, match=f"more than {MOST_VALUES} values"):
        parse_document(NAME, text)


def test_an_alias_repeats_a_value_at_its_own_place():
    document = parse_document(NAME, "a: &p {x: 1}\nb: *p\n")
    assert document.data["b"] == {"x": 1}
    here = document.problem(("b",), "m")
    assert (here.line, here.column) == (2, 4)


@pytest.mark.parametrize("opening", ["[", "{a: ", "- "])
def test_endless_nesting_is_refused(opening):
    with pytest.raises(BadFile, match="nested more than"):
        parse_document(NAME, "a: " + ("\n" if opening == "- " else "") + opening * 300_000)


def test_all_traps_of_a_file_come_at_once_in_order():
    document = parse_document(NAME, "a: 1e3\nb: on\nc: {x: 1, x: 2}\nd: .nan\n1: 2\n")
    places = [(p.line, p.column, p.path) for p in BadFile(document.yaml_problems).problems]
    assert places == [(1, 4, "a"), (2, 4, "b"), (3, 11, "c.x"), (4, 4, "d"), (5, 1, "1")]


def test_a_problem_at_a_missing_key_points_to_its_parent():
    document = parse_document(NAME, "arms:\n  right:\n    springs:\n      - {name: hand}\n")
    missing = document.problem(("arms", "right", "springs", 0, "frame"), "missing")
    assert (missing.line, missing.column) == (4, 9)
    assert missing.path == "arms.right.springs[0].frame"
    deep = document.problem(("arms", "right", "posture", "x"), "missing")
    assert (deep.line, deep.column) == (2, 3)
    key = document.problem(("arms", "right", "springs"), "m", at="key")
    assert (key.line, key.column) == (3, 5)


def test_a_path_is_printed_as_people_write_it():
    assert print_path(("phases", 0, "until", "contact")) == "phases[0].until.contact"
    assert print_path(()) == ""


def write(tmp_path, raw):
    path = tmp_path / "task.yaml"
    path.write_bytes(raw)
    return path


def test_a_huge_file_is_refused_unread(tmp_path, monkeypatch):
    path = write(tmp_path, b"")
    os.truncate(path, 100_000_000)
    monkeypatch.setattr(Path, "open", None)
    with pytest.raises(BadInput, match=f"at most {LARGEST_FILE}"):
        read_document(path)


def test_the_largest_file_is_refused_for_its_many_values(tmp_path):
    with pytest.raises(BadFile, match="more than"):
        read_document(write(tmp_path, b"a: [" + b"1," * 499_000 + b"]"))


def test_binary_and_other_encodings_are_refused_with_their_place(tmp_path):
    for raw in (bytes(range(256)), "a: 1\n".encode("utf-16")):
        with pytest.raises(BadInput, match="binary"):
            read_document(write(tmp_path, raw))
    with pytest.raises(BadFile) as caught:
        read_document(write(tmp_path, "a: 1\nb: é\n".encode("latin-1")))
    problem = caught.value.problems[0]
    assert (problem.line, problem.column) == (2, 4) and "UTF-8" in problem.message


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path):
    document = read_document(write(tmp_path, b"\xef\xbb\xbfa: 1\r\nb: 1\r\n"))
    assert document.data == {"a": 1, "b": 1}
    assert document.problem(("b",), "").line == 2


def test_what_is_no_file_is_refused(tmp_path):
    write(tmp_path, b"a: 1")
    for path, said in (
        (tmp_path, "is a directory"),
        (tmp_path / "tsk.yaml", r"did you mean '.*task\.yaml'"),
        (tmp_path / "nowhere" / "task.yaml", "does not exist"),
        (Path("a\0b"), "cannot be read"),
        (tmp_path / ("x" * 5000), "cannot be read"),
    ):
        with pytest.raises(BadInput, match=said):
            read_document(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_refused_instead_of_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput, match="is a FIFO, not a file"):
        read_document(tmp_path / "pipe")


def test_an_unreadable_file_says_why(tmp_path, monkeypatch):
    path = write(tmp_path, b"a: 1")

    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("impedance_modules.input_files.os.open", refuse)
    with pytest.raises(BadInput, match="cannot be read: Permission denied"):
        read_document(path)
