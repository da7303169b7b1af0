# SPDX-License-Identifier: BSD-3-Clause
"""Schemas: every leaf explains itself, its examples hold, unknown keys are refused, editors find them."""

import pytest
import yaml
from jsonschema import Draft202012Validator

from impedance_modules.spec.locate import find_schema
from impedance_modules.spec.schema import load_schema
from tests.support.paths import CHECKOUT, EVERY_KEY, PRESS_BOX, TESTS

PLAIN = {"number", "integer", "string", "boolean"}


def parts(node, path=""):
    """Every object of a schema, with its path; examples and conditions are no part of it."""
    if isinstance(node, list):
        for i, inner in enumerate(node):
            yield from parts(inner, f"{path}/{i}")
    elif isinstance(node, dict):
        yield path, node
        for key, inner in node.items():
            if key not in {"examples", "enum", "if"}:
                yield from parts(inner, f"{path}/{key}")


def kinds(node):
    said = node.get("type", [])
    return {said} if isinstance(said, str) else set(said)


@pytest.mark.parametrize(("name", "least"), [("task", 50), ("robot", 15), ("patch", 15), ("import-map", 15)])
def test_every_leaf_of_the_schema_explains_itself(name, least):
    schema = load_schema(name)
    Draft202012Validator.check_schema(schema)
    leaves = [(p, node) for p, node in parts(schema) if kinds(node) & PLAIN or {"enum", "const"} & set(node)]
    assert len(leaves) > least
    for path, leaf in leaves:
        assert leaf.get("description") and leaf.get("examples"), path
        validator = Draft202012Validator({**leaf, "$defs": schema.get("$defs", {})})
        assert all(map(validator.is_valid, leaf["examples"])), path
        if kinds(leaf) & {"number", "integer"}:
            assert "unit" in leaf, path
            low, high = (
                {"minimum", "exclusiveMinimum"} & set(leaf),
                {"maximum", "exclusiveMaximum"} & set(leaf),
            )
            assert "enum" in leaf or (low and high), path
        if (
            name != "task"
        ):  # its descriptions are phrases that editors show, its names are checked by their meaning
            assert leaf["description"].endswith("."), path
            assert kinds(leaf) != {"string"} or {"enum", "pattern", "maxLength"} & set(leaf), path


def test_every_object_of_the_schema_refuses_unknown_keys():
    objects = [node for _, node in parts(load_schema("task")) if "object" in kinds(node)]
    assert objects and all(node.get("additionalProperties") is False for node in objects)


@pytest.mark.parametrize("path", [PRESS_BOX, EVERY_KEY], ids=lambda path: path.stem)
def test_the_modeline_leads_editors_to_the_schema(path):
    first = path.read_text().split("\n")[0]
    target = first.removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / target).resolve() == find_schema("task").resolve()


def document_keys(data):
    if isinstance(data, dict):
        return set(data).union(*(document_keys(value) for value in data.values()))
    return set().union(*map(document_keys, data)) if isinstance(data, list) else set()


def test_the_fixture_every_key_has_every_key():
    """Together with tasks that have what excludes something in it: playback, meshes, set-points, submovements."""
    properties = [node.get("properties") for _, node in parts(load_schema("task"))]
    known = set().union(*(given for given in properties if isinstance(given, dict)))
    others = ("slide-over-position", "hold-to-saddle", "hold-to-fouled-pipe")
    following = CHECKOUT / "tasks" / "follow-set-points.yaml"
    shipped = (CHECKOUT / "tasks" / "thesis" / f"{name}.yaml" for name in others)
    neutral = (
        CHECKOUT / "tasks" / "any-robot" / f"{n}.yaml" for n in ("stand-by", "stiffen-up", "two-step-reach")
    )
    data = (TESTS / "data" / f"{name}.yaml" for name in ("every-hinge-key", "hand-posture", "every-path-key"))
    paths = (*neutral, EVERY_KEY, *data, following, *shipped)
    assert known <= set().union(*(document_keys(yaml.safe_load(path.read_text())) for path in paths))
