# SPDX-License-Identifier: BSD-3-Clause
"""The diagnosis end to end, on recordings made here by a simulator of two joints that shares no code with it."""

import json
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.signal import lfilter

from impedance_modules.spec.schema import load_schema
from tests.support.commands import invoke, refusal
from tests.support.recordings import columns_of, save

RATE = 100.0
JOINTS = ("shoulder", "elbow")
URDF = """<robot name="pendulum"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
<link name="fore"><inertial><origin xyz="0 0 -0.15"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="9" effort="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 -0.4"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="9" effort="50"/></joint></robot>"""


def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray, mass: float) -> np.ndarray:
    """Lagrange's equations of the double pendulum, written out by hand; ``mass`` scales the first link."""
    m1, m2, c1, c2, length, I1, I2, g = 2.0 * mass, 1.0, 0.2, 0.15, 0.4, 0.03 * mass, 0.01, 9.81
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    h = m2 * length * c2
    M11 = I1 + I2 + m1 * c1**2 + m2 * (length**2 + c2**2) + 2 * h * cosine
    M12 = I2 + m2 * c2**2 + h * cosine
    coriolis = -h * sine * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    g2 = m2 * g * c2 * np.sin(q.sum(axis=1))
    g1 = (m1 * c1 + m2 * length) * g * np.sin(q[:, 0]) + g2
    tau1 = M11 * a[:, 0] + M12 * a[:, 1] + coriolis + g1
    tau2 = M12 * a[:, 0] + (I2 + m2 * c2**2) * a[:, 1] + h * sine * v[:, 0] ** 2 + g2
    return np.column_stack([tau1, tau2])


def motion(kind: int, seconds: float) -> tuple[np.ndarray, ...]:
    random = np.random.default_rng(100 + kind)
    t = np.arange(int(seconds * RATE)) / RATE
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for joint in range(2):
        for _ in range(4):
            w, size = 2 * np.pi * random.uniform(0.08, 0.9), random.uniform(0.1, 0.4)
            phase = random.uniform(0, 6)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return t, q, v, a


def touching(t: np.ndarray) -> np.ndarray:
    return (t > 8.0) & (t < 11.0)


ADDED = {
    "nothing": (0, lambda t, q, v, kind: 0.0 * t),
    "viscous_friction": (1, lambda t, q, v, kind: 0.3 * v[:, 1]),
    "coulomb_friction": (1, lambda t, q, v, kind: 0.25 * np.sign(v[:, 1])),
    "parallel_spring": (0, lambda t, q, v, kind: 3.0 * q[:, 0] + 1.0),
    "tone": (1, lambda t, q, v, kind: 0.02 * np.sin(19.0 * t + kind)),
    "faint tone": (1, lambda t, q, v, kind: 0.0004 * np.sin(19.0 * t + kind)),
    "little friction": (1, lambda t, q, v, kind: 0.012 * np.sign(v[:, 1])),
    "faint friction": (1, lambda t, q, v, kind: 0.0003 * np.sign(v[:, 1])),
    "table": (1, lambda t, q, v, kind: 2.0 * touching(t)),
    "sudden_stop": (1, lambda t, q, v, kind: 1.5 * (np.abs(q[:, 1] - 0.1) < 0.07) * (t % 3.0 < 1.5)),
}
"""Which joint's torque an effect changes, and by how much."""


def record(
    folder: Path,
    effect: str,
    *,
    seconds: float = 20.0,
    noise: float = 0.05,
    jitter: float = 1e-5,
    knock: Callable[[np.ndarray, int], np.ndarray] = lambda t, index: 0.0 * t,
) -> list[Path]:
    paths = []
    for index, (kind, repeat) in enumerate([(0, None), (0, "run0"), (1, None), (2, None), (3, None)]):
        random = np.random.default_rng(index)
        t, q, v, a = motion(kind, seconds)
        tau = torque(q, v, a, mass=1.02)
        joint, law = ADDED[effect]
        tau[:, joint] += law(t, q, v, kind)
        tau[:, 1] += knock(t, index)
        tau += random.normal(scale=noise, size=tau.shape)
        q = q + random.normal(scale=jitter, size=q.shape)
        columns = columns_of(t, JOINTS, position=q, effort=tau)
        if effect == "table":
            columns["phase"] = np.where(touching(t), "contact", "free")
        paths.append(save(folder, f"run{index}", columns, repeat_of=repeat))
    return paths


def answer(folder: Path, paths: list[Path], *more: str) -> tuple[int, dict]:
    (folder / "robot.urdf").write_text(URDF)
    return diagnosed(folder, *paths, "--urdf", folder / "robot.urdf", *more)


def diagnosed(folder: Path, *words: object) -> tuple[int, dict]:
    """Exit code and answer, which keeps to its schema."""
    code = invoke("diagnose", *words, "--json", folder / "answer.json").return_value
    found = json.loads((folder / "answer.json").read_text())
    jsonschema.validate(found, load_schema("diagnosis"))
    return code, found


@pytest.mark.parametrize(
    ("effect", "joint", "symbol", "value"),
    [
        ("viscous_friction", "elbow", "fv", 0.3),
        ("coulomb_friction", "elbow", "fc", 0.25),
        ("parallel_spring", "shoulder", "k", 3.0),
    ],
)
def test_single_effect_is_named(tmp_path: Path, effect: str, joint: str, symbol: str, value: float) -> None:
    code, found = answer(tmp_path, record(tmp_path, effect))
    first = found["causes"][0]
    assert (first["effect"], first["joints"]) == (effect, [joint])
    assert first["parameters"][joint][symbol]["value"] == pytest.approx(value, rel=0.15)
    assert found["gap"]["shrink"] > 0.8
    assert code in (0, 6)


def test_clean_recordings_raise_no_alarm(tmp_path: Path) -> None:
    code, found = answer(tmp_path, record(tmp_path, "nothing"))
    assert (code, found["verdict"], found["causes"]) == (0, "no_gap", [])


@pytest.mark.parametrize("seed", [0, 2, pytest.param(3, marks=pytest.mark.long)])
def test_what_a_sensor_does_not_show_of_a_commands_noise_is_no_lag(tmp_path: Path, seed: int) -> None:
    """A controller answers its sensors' noise; the motor, or the logger, filters that. No motion was repeated."""
    paths = []
    for kind in range(3):
        random = np.random.default_rng(10 * seed + kind)
        t, q, v, a = motion(kind, 20.0)
        tau = torque(q, v, a, mass=1.0)
        asked = tau + lfilter([0.5], [1.0, -0.5], random.normal(scale=0.3, size=tau.shape), axis=0)
        tau += random.normal(scale=0.02, size=tau.shape)
        q = q + random.normal(scale=1e-5, size=q.shape)
        columns = columns_of(t, JOINTS, position=q, effort=tau, effort_command=asked)
        paths.append(save(tmp_path, f"run{kind}", columns))
    code, found = answer(tmp_path, paths)
    assert (code, found["verdict"], found["causes"]) == (0, "no_gap", [])


def test_what_is_in_no_catalogue_is_not_called_explained(tmp_path: Path) -> None:
    code, found = answer(tmp_path, record(tmp_path, "sudden_stop"))
    assert found["verdict"] in ("unexplained", "partly_explained")
    assert code == 5


def test_samples_in_contact_are_masked(tmp_path: Path) -> None:
    """Phases are read from the file: a table that holds the elbow up is no property of the arm."""
    code, found = answer(tmp_path, record(tmp_path, "table"))
    assert (code, found["verdict"]) == (0, "no_gap")
    assert any("in contact, by the phases" in note for note in found["data"]["warnings"])


@pytest.mark.parametrize(
    ("effect", "verdict"), [("faint tone", "no_gap"), ("faint friction", "no_gap"), ("tone", "unexplained")]
)
def test_a_thousandth_of_the_load_is_no_gap(tmp_path: Path, effect: str, verdict: str) -> None:
    """A simulator's log without noise shows its own integration: nobody's gap, and no cause."""
    _, found = answer(tmp_path, record(tmp_path, effect, noise=1e-5, jitter=1e-8), "--tolerance", "0")
    assert (found["verdict"], found["causes"]) == (verdict, [])


def test_report_and_patch_are_written_and_the_patch_closes_the_gap(tmp_path: Path) -> None:
    paths = record(tmp_path, "viscous_friction")
    patch, report = tmp_path / "patch.yaml", tmp_path / "report.html"
    answer(tmp_path, paths, "--patch", str(patch), "--report", str(report))
    text = report.read_text()
    assert "<svg" in text and "src=" not in text and 'http-equiv="refresh"' not in text
    assert "default-src 'none'; script-src 'sha256-" in text
    code, again = answer(tmp_path, paths, "--effects", str(patch))
    assert "viscous_friction" not in [cause["effect"] for cause in again["causes"]]
    assert code == 0


def test_short_and_slow_recordings_are_insufficient(tmp_path: Path) -> None:
    paths = record(tmp_path, "nothing", seconds=0.5)
    code, found = answer(tmp_path, paths)
    assert (code, found["verdict"]) == (7, "insufficient_data")
    assert "samples" in found["data"]["reason"]


def test_unknown_effect_and_missing_model_are_refused(tmp_path: Path) -> None:
    paths = record(tmp_path, "nothing", seconds=2.0)
    (tmp_path / "robot.urdf").write_text(URDF)
    without = refusal("diagnose", *paths, "--urdf", tmp_path / "robot.urdf", "--without", "payloat")
    assert "did you mean 'payload'" in without
    assert "give --robot NAME or --urdf FILE" in refusal("diagnose", paths[0])
