# SPDX-License-Identifier: BSD-3-Clause
"""``analyze``: its JSON has every number of its text, and what it lists adds up to what it says is the sum."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.robot.pose import carry
from tests.support.commands import invoke
from tests.support.forecast_tasks import BOX, HOLD_AND_LIFT, assembled, wipe, write_task

AXES = ("x", "y", "z", "rx", "ry", "rz")
MATRICES = (
    "inertia", "inertia_without_reflected", "mobility", "damping", "stiffness", "compliance",
    "stiffness_without_preload",
)  # fmt: skip
BIAS = next(line for line in BOX.splitlines() if "joint_bias" in line)
Told = list[tuple[str, str, tuple[float, ...] | None]]
"""Section, what the numbers are, and the numbers as printed; None for what does not exist."""


def analyse(*words: object, file: Path) -> tuple[dict, str]:
    printed = invoke("analyze", *words, "--json", file).stdout
    return json.loads(file.read_text()), printed


def numbers(text: str) -> tuple[float, ...]:
    return tuple(float(found) for found in re.findall(r"(?<![\w^])-?\d+\.?\d*(?:e[-+]\d+)?", text))


def in_text(printed: str) -> Told:
    """Takes the text apart; a line with a number that is not known for what it is fails."""
    told: Told = []
    section, title, rows = "", "", []
    titles = [(name.replace("_", " ") + " ", name) for name in sorted(MATRICES, key=len, reverse=True)]
    for line in printed.splitlines()[1:]:
        words = line.strip()
        if line.startswith("─"):
            section, title = words.strip("─ ").split(":")[0], ""
        elif words == "does not exist":
            told.append((section, title, None))
        elif title and words.split(" ")[0] in AXES and "|" in words:
            rows.append(numbers(words.split(" ", 1)[1].replace("|", " ")))
            if len(rows) == len(AXES):
                told.append((section, title, tuple(np.ravel(rows))))
        elif found := re.match(
            r"((?:inertia|mobility|stiffness), (?:linear|angular)) +(.*) \S+ +\((.*)\)$", words
        ):
            told.append((section, found[1], numbers(found[2]) + numbers(found[3])))
        elif found := re.match(
            r"(origin|from the end|preload|modules exert|surfaces press|friction|modes|hands squeeze|'\w+' exerts"
            r"|\w+: coupling)",
            words,
        ):
            text = words[found.end() :] if found[1] != "modes" else words.replace("free", "0 0")
            told.append((section, found[1], numbers(text)))
        elif found := re.match(
            r"(inertia|stiffness) (of '(\w+)', at|of the object itself|by the load)", words
        ):
            title, rows = f"{found[1]} {found[3] or ('load' if 'load' in words else 'object')}", []
        elif known := [name for start, name in titles if words.startswith(start)]:
            title, rows = known[0], []
        else:
            assert not re.search(r"\d", words), f"unknown line: {line}"
    return told


def rounded(values: object, form: str) -> tuple[float, ...]:
    found = np.ravel(np.array(values, dtype=float))
    largest = np.max(np.abs(found)) if form == ".3g" else 0.0
    return tuple(0.0 if abs(v) < 1e-9 * largest else float(format(v, form)) + 0.0 for v in found)


def in_json(found: dict) -> Told:
    told: Told = []
    for limb, arm in found["arms"].items():
        told += of_frame(limb, arm)
    held = found["object"]
    if held is not None:
        told += of_sum(held)
        told += of_frame("object", held)
    return told


def of_sum(held: dict) -> Iterator[tuple[str, str, tuple[float, ...] | None]]:
    for name in ("inertia", "stiffness"):
        parts = held["summands"][name]
        named = {**parts["arms"], **{key: part for key, part in parts.items() if key != "arms"}}
        for part, matrix in named.items():
            yield "object", f"{name} {part}", None if matrix is None else rounded(matrix, ".3g")
    for name in ("inertia", "stiffness"):
        coupling = held["coupling"][name]
        shares = [share for share in (*coupling["arms"].values(), coupling["sum"]) if share is not None]
        yield "object", f"{name}: coupling", rounded(100.0 * np.array(shares), ".2f")
    yield "object", "hands squeeze", rounded(held["squeeze"], ".2f")
    for limb, wrench in held["internal"].items():
        yield "object", f"'{limb}' exerts", rounded(wrench, ".3f")


def of_frame(section: str, frame: dict) -> Iterator[tuple[str, str, tuple[float, ...] | None]]:
    yield section, "origin", rounded([*frame["position"], *frame["orientation"]], ".3f")
    if frame["until_rest"] is not None:
        yield section, "from the end", rounded(max(frame["until_rest"].values(), key=abs), ".3f")
    yield section, "preload", rounded(frame["preload"], ".3f")
    yield section, "modules exert", rounded(frame["wrench"], ".3f")
    if frame["pressure"] is not None:
        yield section, "surfaces press", rounded(frame["pressure"], ".3f")
    if frame["friction"] is not None:
        yield (
            section,
            "friction",
            rounded([frame["friction"]["force"], *frame["friction"]["position"]], ".3f"),
        )
    for name in MATRICES:
        if name != "compliance" or frame[name] is not None:
            yield section, name, None if frame[name] is None else rounded(frame[name], ".3g")
    for name, pair in frame["ellipsoids"].items():
        for kind, axes in (pair or {}).items():
            largest = axes["directions"][int(np.argmax(np.abs(axes["values"])))]
            yield section, f"{name}, {kind}", rounded(axes["values"], ".4g") + rounded(largest, ".3f")
    pairs = [
        (0.0, 0.0) if mode["damping_ratio"] is None else (mode["frequency"], mode["damping_ratio"])
        for mode in frame["modes"][:10]
    ]
    yield section, "modes", rounded(pairs, ".2f")


def rotation_of(quaternion: list[float]) -> np.ndarray:
    """Of a unit quaternion x, y, z, w, by the sandwich product of every axis."""
    *vector, scalar = quaternion
    v = np.array(vector)
    return np.array([a + 2.0 * np.cross(v, np.cross(v, a) + scalar * a) for a in np.eye(3)]).T


def texts(folder: Path) -> dict[str, tuple[object, ...]]:
    """Commands: at the start and at rest, free, in contact, held, singular."""
    written = {"box": BOX, "free": HOLD_AND_LIFT, "bare": BOX.replace(BIAS + "\n", "")}
    paths = {}
    for name, text in written.items():
        (folder / name).mkdir()
        paths[name] = write_task(folder / name, text)
    (folder / "wipe").mkdir()
    return {
        "box at the start": (paths["box"],),
        "box on the table": (paths["box"], "--phase", "lower"),
        "no joint springs": (paths["bare"],),
        "free": (paths["free"], "--phase", "lift"),
        "wiping": (wipe(folder / "wipe"), "--phase", "press"),
        "singular": ("arm-stretched",),
        "on the bent sheet": ("slide-over", "--phase", "stay"),
    }


@pytest.mark.parametrize(
    "which",
    [
        "box at the start",
        "box on the table",
        "no joint springs",
        "free",
        "wiping",
        "singular",
        "on the bent sheet",
    ],
)
def test_text_and_json_agree_number_by_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, which: str
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    found, printed = analyse(*texts(tmp_path)[which], file=tmp_path / "analysis.json")
    text, expected = in_text(printed), in_json(found)
    assert [line[:2] for line in text] == [line[:2] for line in expected]
    for line, wanted in zip(text, expected, strict=True):
        assert line == wanted
    assert len(expected) > 10


@pytest.mark.parametrize("seed", range(4))
def test_what_is_listed_adds_up_to_the_sum(tmp_path: Path, seed: int) -> None:
    """From the JSON alone, box turned and pressed on the table by chance: matrices, wrenches, internal forces."""
    random = np.random.default_rng(seed)
    x, z, ry = 0.6 + 0.08 * random.random(), -0.01 - 0.06 * random.random(), 0.15 * random.normal()
    changes = (
        ("{z: -0.05}", f"{{x: {x:.3f}, z: {z:.3f}, ry: {ry:.3f}}}"),
        ("squeeze: {force: 10}", f"squeeze: {{force: {5 + 20 * random.random():.1f}}}"),
        ("mass: 1,", f"mass: {0.5 + random.random():.2f},"),
    )
    path = write_task(tmp_path, BOX, *changes)
    found, _ = analyse(path, "--phase", "lower", file=tmp_path / "analysis.json")
    held, arms = found["object"], found["arms"]
    for name, parts in held["summands"].items():
        total = sum(
            np.array(part) for part in (*parts["arms"].values(), *([parts[k] for k in parts if k != "arms"]))
        )
        np.testing.assert_allclose(total, held[name], rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(held["summands"]["stiffness"]["load"])) > 1e-3
    carried = {
        limb: carry(np.array(arm["position"]) - np.array(held["position"])) for limb, arm in arms.items()
    }
    for name in ("preload", "wrench"):
        total = sum(carried[limb].T @ np.array(arm[name]) for limb, arm in arms.items())
        np.testing.assert_allclose(total, held[name], atol=1e-8)
    internal = sum(carried[limb].T @ np.array(wrench) for limb, wrench in held["internal"].items())
    np.testing.assert_allclose(internal, 0.0, atol=1e-8)
    weight = 9.81 * held["summands"]["inertia"]["object"][0][0]
    balance = np.array(held["wrench"]) + np.array(held["pressure"])
    np.testing.assert_allclose(balance, [0.0, 0.0, weight, 0.0, 0.0, 0.0], atol=1e-6)
    assert held["squeeze"] > 1.0
    within, across = [0, 2, 4], [1, 3, 5]  # x, z and turning about y; y and turning about x and z
    for name in ("inertia", "stiffness"):
        parts, shares = held["summands"][name]["arms"], held["coupling"][name]
        for matrix, share in (
            (held[name], shares["sum"]),
            *((parts[limb], shares["arms"][limb]) for limb in parts),
        ):
            K = np.array(matrix)
            mixed = max(np.max(np.abs(K[np.ix_(within, across)])), np.max(np.abs(K[np.ix_(across, within)])))
            assert share == pytest.approx(mixed / np.max(np.abs(K)), rel=1e-9, abs=1e-15)
        assert min(shares["arms"].values()) > 10.0 * shares["sum"] > 0.0


def test_a_hand_at_rest_exerts_what_the_surfaces_press(tmp_path: Path) -> None:
    """Newton's third law at the palm, and the orientation is the frame's: it turns with the target."""
    found, _ = analyse(wipe(tmp_path), "--phase", "press", file=tmp_path / "analysis.json")
    hand = found["arms"]["right"]
    np.testing.assert_allclose(np.add(hand["wrench"], hand["pressure"]), 0.0, atol=1e-6)
    assert hand["pressure"][2] > 1.0 and found["object"] is None


def test_orientations_are_those_of_the_frames_and_ellipsoids_the_matrices_own(tmp_path: Path) -> None:
    """The hand's by forward kinematics of the joints in the JSON; the box's grasp is what it was at the start."""
    path = write_task(tmp_path, BOX, ("{z: -0.05}", "{z: 0.05, rz: 0.2}"))
    model, hands, boxes = assembled(path).model, [], []
    for words in ((), ("--phase", "lower")):
        found = analyse(path, *words, file=tmp_path / "analysis.json")[0]
        hand, held = found["arms"]["right"], found["object"]
        q = np.zeros(model.n)
        for joint, angle in held["q"].items():
            q[model.joint_names.index(joint)] = angle
        pose = model.pose(q, hand["frame"])
        np.testing.assert_allclose(rotation_of(hand["orientation"]), pose.rotation, atol=1e-12)
        np.testing.assert_allclose(hand["position"], pose.translation, atol=1e-12)
        hands.append(pose.rotation)
        boxes.append(rotation_of(held["orientation"]))
    np.testing.assert_allclose(boxes[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(boxes[1].T @ hands[1], hands[0], atol=1e-9)
    assert np.max(np.abs(boxes[1] - boxes[0])) > 0.03
    for name, pair in held["ellipsoids"].items():
        for start, kind in ((0, "linear"), (3, "angular")):
            block = np.array(held[name])[start : start + 3, start : start + 3]
            for value, direction in zip(pair[kind]["values"], pair[kind]["directions"], strict=True):
                pushed = 0.5 * (block + block.T) @ np.array(direction)
                np.testing.assert_allclose(
                    pushed, value * np.array(direction), atol=1e-8 * np.abs(block).max()
                )
