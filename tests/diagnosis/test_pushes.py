# SPDX-License-Identifier: BSD-3-Clause
"""A hand that is pushed in one recording, with no repeat to compare: one force explains six joints, chance does not.

The recordings are made by pinocchio's inverse dynamics and Jacobian, which the diagnosis does not use.
"""

from pathlib import Path

import numpy as np
import pinocchio
import pytest

from tests.diagnosis.test_diagnosis import diagnosed
from tests.support.paths import TESTS
from tests.support.recordings import columns_of, save

URDF = TESTS / "robots" / "six_joint_pair" / "six_joint_pair.urdf"
JOINTS = ("turn", "lift", "bend", "roll", "tilt", "spin")
MIDDLE = np.array([0.3, 0.4, -1.0, 0.2, 0.6, -0.3])
RATE, SECONDS = 100.0, 14.0
PUSH = np.array([6.0, -4.0, 9.0])
"""On the palm, world axes [N]."""
BUMP = np.array([2.0, -1.5, 1.8, 0.0, 0.0, 0.0])
"""On three shoulders' joints [N.m], each once, twice or three times to and fro: as strong, and no steady force."""
SWINGS = np.array([1.0, 2.0, 3.0, 1.0, 1.0, 1.0])


def arm() -> tuple[pinocchio.Model, list[int]]:
    """The model, and the six joints' places in its vectors."""
    model = pinocchio.buildModelFromUrdf(str(URDF))
    return model, [model.joints[model.getJointId(f"port_{name}")].idx_v for name in JOINTS]


def tones(kind: int, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (N, 6), velocities and accelerations."""
    random = np.random.default_rng(40 + kind)
    w = 2 * np.pi * random.uniform(0.1, 0.8, (3, 6))
    size, phase = random.uniform(0.05, 0.25, (2, 3, 6)) * np.array([1.0, 20.0])[:, None, None]
    angle = w * time[:, None, None] + phase
    return (
        MIDDLE + np.sum(size * np.sin(angle), axis=1),
        np.sum(size * w * np.cos(angle), axis=1),
        -np.sum(size * w**2 * np.sin(angle), axis=1),
    )


def record(
    folder: Path, kind: int, happens: str, begins: float | None = None, repeat_of: str | None = None
) -> Path:
    """One recording; from ``begins`` on something happens for a second, in the first one at 6 s if that is not said."""
    model, places = arm()
    data, palm = model.createData(), model.getFrameId("port_palm")
    random = np.random.default_rng(kind if repeat_of is None else 100 + kind)
    begins = begins if begins is not None else 6.0 if kind == 0 else np.inf
    time = np.arange(int(SECONDS * RATE)) / RATE
    q, v, a = tones(kind, time)
    effort = np.zeros_like(q)
    whole = np.zeros((3, model.nv))
    for row, now in enumerate(time):
        whole[:, places] = q[row], v[row], a[row]
        effort[row] = pinocchio.rnea(model, data, *whole)[places]
        during = begins < now < begins + 1.0
        strength = np.sin(np.pi * (now - begins)) if during else 0.0
        if happens == "push" and strength > 0.0:
            J = pinocchio.computeFrameJacobian(model, data, whole[0], palm, pinocchio.LOCAL_WORLD_ALIGNED)
            effort[row] -= strength * (J[:3, places].T @ PUSH)
        if happens == "bump" and during:
            effort[row] += np.sin(np.pi * SWINGS * (now - begins)) * BUMP
    effort += random.normal(scale=0.05, size=effort.shape)
    q += random.normal(scale=1e-5, size=q.shape)
    columns = columns_of(time, [f"port_{name}" for name in JOINTS], position=q, effort=effort)
    name = f"run{kind}" if repeat_of is None else f"again{kind}"
    return save(folder, name, columns, robot="six_joint_pair", repeat_of=repeat_of)


@pytest.mark.parametrize("elsewhere", [True, False])
def test_what_a_repeat_shows_too_is_a_push_where_another_recording_is_pushed_there(tmp_path, elsewhere):
    """A force at one time of a motion may be the robot's own, but not on a link that is pushed elsewhere, too."""
    paths = [
        record(tmp_path, 0, "push"),
        record(tmp_path, 0, "push", begins=6.1, repeat_of="run0"),
        record(tmp_path, 1, "push" if elsewhere else "nothing", begins=9.0),
        record(tmp_path, 2, "nothing"),
    ]
    _, found = diagnosed(tmp_path, *paths[:3], "--holdout", paths[3], "--urdf", URDF)
    notes = [note for note in found["data"]["warnings"] if "pushed from outside" in note]
    assert (found["verdict"] == "explained") is elsewhere
    assert len(notes) == (3 if elsewhere else 0), notes


@pytest.mark.parametrize("happens", ["push", "bump"])
def test_a_push_is_named_and_three_torques_that_no_steady_force_explains_are_none(tmp_path, happens):
    paths = [record(tmp_path, kind, happens) for kind in range(3)]
    _, found = diagnosed(tmp_path, *paths[:2], "--holdout", paths[2], "--urdf", URDF)
    pushes = [cause for cause in found["causes"] if cause["effect"] == "external_contact"]
    if happens == "bump":
        assert not pushes and found["verdict"] in ("unexplained", "partly_explained")
        return
    (push,) = pushes
    ((link, numbers),) = push["parameters"].items()
    assert link == "port_palm"
    assert 5.2 < numbers["start"]["value"] < 6.5 < numbers["end"]["value"] < 7.8
    mean = np.array([numbers[axis]["value"] for axis in ("fx", "fy", "fz")])
    assert float(mean @ PUSH) > 0.95 * float(np.linalg.norm(mean) * np.linalg.norm(PUSH))
    lasted = numbers["end"]["value"] - numbers["start"]["value"]
    impulse = float(np.linalg.norm(PUSH)) * 2.0 / np.pi
    assert float(np.linalg.norm(mean)) * lasted == pytest.approx(
        1.2 * impulse, rel=0.1
    )  # hats overlap its ends
    assert [cause["effect"] for cause in found["causes"]] == ["external_contact"]


LEAN = np.array([1.2, -0.8, 1.8])
"""On the palm for two seconds, world axes [N]."""


def leant_on(
    folder: Path, kind: int, name: str, *, repeat_of: str | None = None, pushed: bool = False
) -> Path:
    """A recording with little noise of an arm whose links are 2 % heavier than described."""
    model, places = arm()
    for inertia in model.inertias:
        inertia.mass *= 1.02
    data, palm = model.createData(), model.getFrameId("port_palm")
    random = np.random.default_rng(len(name) + sum(map(ord, name)))
    time = np.arange(int(SECONDS * RATE)) / RATE
    q, v, a = tones(kind, time)
    effort, whole = np.zeros_like(q), np.zeros((3, model.nv))
    for row, now in enumerate(time):
        whole[:, places] = q[row], v[row], a[row]
        effort[row] = pinocchio.rnea(model, data, *whole)[places]
        if pushed and 6.0 < now < 8.2:
            J = pinocchio.computeFrameJacobian(model, data, whole[0], palm, pinocchio.LOCAL_WORLD_ALIGNED)
            effort[row] -= J[:3, places].T @ LEAN
    effort += random.normal(scale=0.004, size=effort.shape)
    q += random.normal(scale=1e-6, size=q.shape)
    columns = columns_of(time, [f"port_{name}" for name in JOINTS], position=q, effort=effort)
    return save(folder, name, columns, robot="six_joint_pair", repeat_of=repeat_of)


@pytest.mark.parametrize("repeated", [False, True])
def test_a_long_push_moves_neither_the_links_nor_the_noise_of_other_moments(
    tmp_path: Path, repeated: bool
) -> None:
    """It is a sixth of one recording, and a hundred times the noise."""
    paths = [leant_on(tmp_path, 0, "pushed", pushed=True)]
    paths.append(leant_on(tmp_path, 0 if repeated else 1, "other", repeat_of="pushed" if repeated else None))
    paths += [leant_on(tmp_path, kind, f"more{kind}") for kind in (2, 3)]
    _, found = diagnosed(tmp_path, *paths, "--urdf", URDF)
    assert [cause["effect"] for cause in found["causes"]] == ["external_contact"]
    assert found["verdict"] == "explained"
    (numbers,) = found["causes"][0]["parameters"].values()
    mean = np.array([numbers[axis]["value"] for axis in ("fx", "fy", "fz")])
    assert float(mean @ LEAN) > 0.95 * float(np.linalg.norm(mean) * np.linalg.norm(LEAN))
