# SPDX-License-Identifier: BSD-3-Clause
"""The task schema: every leaf explains itself, unknown keys are refused, editors find it."""

import pytest
import yaml

from impedance_modules.spec.locate import find_schema
from impedance_modules.spec.schema import load_schema
from tests.support.paths import CHECKOUT, TESTS

HERE = TESTS
PRESS_BOX = HERE / "data" / "press-box.yaml"
EVERY_KEY = HERE / "data" / "every-key.yaml"


def schema_leaves(node, path=""):
    if isinstance(node, list):
        for i, inner in enumerate(node):
            yield from schema_leaves(inner, f"{path}/{i}")
    elif isinstance(node, dict):
        kinds = node.get("type", [])
        if {"number", "string", "boolean"} & set(
            [kinds] if isinstance(kinds, str) else kinds
        ) or "enum" in node:
            yield path, node
        for key, inner in node.items():
            if key not in {"examples", "enum", "if"}:
                yield from schema_leaves(inner, f"{path}/{key}")


def test_every_leaf_of_the_schema_explains_itself():
    leaves = list(schema_leaves(load_schema("task")))
    assert len(leaves) > 50
    for path, leaf in leaves:
        assert leaf.get("description") and leaf.get("examples"), path
        if "number" in leaf.get("type", []):
            assert "unit" in leaf and "maximum" in leaf, path
            assert "minimum" in leaf or "exclusiveMinimum" in leaf, path


def test_every_object_of_the_schema_refuses_unknown_keys():
    def objects(node):
        if isinstance(node, dict):
            if "object" in node.get("type", []):
                yield node
            for inner in node.values():
                yield from objects(inner)
        elif isinstance(node, list):
            for inner in node:
                yield from objects(inner)

    assert all(node.get("additionalProperties") is False for node in objects(load_schema("task")))


def test_the_schema_is_a_schema_and_its_examples_hold():
    from jsonschema import Draft202012Validator

    schema = load_schema("task")
    Draft202012Validator.check_schema(schema)
    for path, leaf in schema_leaves(schema):
        for example in leaf["examples"]:
            validator = Draft202012Validator({**leaf, "$defs": schema["$defs"]})
            assert validator.is_valid(example), (path, example)


@pytest.mark.parametrize("path", [PRESS_BOX, EVERY_KEY], ids=lambda path: path.stem)
def test_the_modeline_leads_editors_to_the_schema(path):
    first = path.read_text().split("\n")[0]
    target = first.removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / target).resolve() == find_schema("task").resolve()


def schema_keys(schema):
    """Every key that the task schema knows."""
    if isinstance(schema, list):
        return set().union(*map(schema_keys, schema)) if schema else set()
    if not isinstance(schema, dict):
        return set()
    own = set(schema.get("properties", {})) if isinstance(schema.get("properties"), dict) else set()
    return own.union(*(schema_keys(value) for value in schema.values()))


def document_keys(data):
    if isinstance(data, dict):
        return set(data).union(*(document_keys(value) for value in data.values()))
    return set().union(*map(document_keys, data)) if isinstance(data, list) and data else set()


def test_the_fixture_every_key_has_every_key():
    """Together with a task that is played back, which holds and is pushed by nothing."""
    played = CHECKOUT / "tasks" / "thesis" / "slide-over-position.yaml"
    keys = [document_keys(yaml.safe_load(path.read_text())) for path in (EVERY_KEY, played)]
    assert schema_keys(load_schema("task")) <= set().union(*keys)
