# SPDX-License-Identifier: BSD-3-Clause
"""Logs as robots' own software writes them, of motions whose torques are known; nothing of the package is used."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.import_logs import write_table


@dataclass(frozen=True, eq=False)
class Run:
    """One recording: (N,) time [s]; (N, n) positions, velocities, accelerations and torques."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    torque: np.ndarray


Law = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def swinging(kind: int, joints: int, *, seconds: float, rate: float, size: float = 0.35) -> Run:
    """Sums of sines about zero, other ones for each kind, without torque."""
    dice = np.random.default_rng(300 + kind)
    time = np.arange(int(seconds * rate)) / rate
    pulse = 2.0 * np.pi * dice.uniform(0.1, 0.9, (4, joints))
    width, phase = dice.uniform(0.3, 1.0, (4, joints)) * size, dice.uniform(0.0, 6.0, (4, joints))
    angle = time[:, None, None] * pulse + phase
    q = (width * np.sin(angle)).sum(1)
    v = (width * pulse * np.cos(angle)).sum(1)
    a = -(width * pulse**2 * np.sin(angle)).sum(1)
    return Run(time, q, v, a, np.zeros_like(q))


def with_torque(
    run: Run,
    model: pin.Model,
    joints: Sequence[str],
    law: Law,
    *,
    about: np.ndarray | float = 0.0,
    noise: float = 0.02,
) -> Run:
    """A run about a posture, with the torque of a pinocchio model's joints and of a law, and sensors' noise."""
    data, dice = model.createData(), np.random.default_rng(len(run.time))
    q = run.q + about
    torque = np.zeros_like(q)
    full_q, full_v, full_a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    ids = [model.joints[model.getJointId(name)] for name in joints]
    for row in range(len(q)):
        for column, joint in enumerate(ids):
            angle = q[row, column]
            turned = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            full_q[joint.idx_q : joint.idx_q + joint.nq] = turned
            full_v[joint.idx_v], full_a[joint.idx_v] = run.v[row, column], run.a[row, column]
        whole = pin.rnea(model, data, full_q, full_v, full_a)
        torque[row] = [whole[joint.idx_v] for joint in ids]
    torque = torque + law(q, run.v, torque)
    torque = torque + dice.normal(scale=noise * np.maximum(torque.std(0), 0.05), size=q.shape)
    return Run(run.time, q + dice.normal(scale=1e-5, size=q.shape), run.v, run.a, torque)


def write_franka(path: Path, run: Run, *, spaced: bool, command: bool = False) -> Path:
    """franka::logToCSV: seven joints, time in milliseconds; older versions put blanks into the header."""
    count = run.q.shape[1]
    comma = ", " if spaced else ","

    def names(name: str, size: int = count) -> str:
        return comma.join(f"{name}[{index}]" for index in range(size))

    state = ["state.q", "state.q_d", "state.dq", "state.dq_d", "state.tau_J", "state.tau_ext_hat_filtered"]
    order = [names(name) for name in state]
    order += [names("cmd.q_d"), names("cmd.dq_d"), names("cmd.O_T_EE_d", 16), names("cmd.O_dP_EE_d", 6)]
    header = comma.join(["time", "success_rate"]) + comma + ",".join([*order, names("cmd.tau_J_d")])
    none = np.zeros_like(run.q)
    asked = run.torque if command else none
    rows = np.column_stack(
        [np.round(1e3 * run.time) + 41000, 0.99 + none[:, 0], run.q, run.q, run.v, run.v, run.torque, none, none,
         none, np.zeros((len(none), 22)), asked]
    )  # fmt: skip
    with path.open("w") as stream:
        stream.write(header + "\n")
        np.savetxt(stream, rows, delimiter=",", fmt="%.9g")
    return path


def write_rtde(path: Path, run: Run, ampere: np.ndarray, separator: str = ",") -> Path:
    """An RTDE client's record: timestamp in seconds since the controller began, each quantity by joint number."""
    count = run.q.shape[1]
    kinds = {
        "target_q": run.q + 0.002 * run.v, "target_moment": run.torque, "actual_q": run.q, "actual_qd": run.v,
        "actual_current": run.torque / ampere,
    }  # fmt: skip
    header = ["timestamp", *(f"{name}_{index}" for name in kinds for index in range(count))]
    return write_table(path, header, 5123.5 + run.time, *kinds.values(), separator=separator, form="%.10g")


def write_lerobot(
    folder: Path,
    runs: Sequence[Run],
    names: Sequence[str],
    *,
    rate: float,
    scale: float,
    offset: float = 0.0,
    effort: bool = True,
) -> Path:
    """A LeRobot v3 dataset: all episodes in one file, timestamps and numbers as float32."""  # fmt: skip
    count = len(names)
    entries = [f"{name}.pos" for name in names]
    features = {
        "action": {"dtype": "float32", "names": entries, "shape": [count]},
        "observation.state": {"dtype": "float32", "names": entries, "shape": [count]},
        **(
            {"observation.effort": {"dtype": "float32", "names": list(names), "shape": [count]}}
            if effort
            else {}
        ),
        "observation.images.top": {
            "dtype": "video",
            "shape": [480, 640, 3],
            "names": ["height", "width", "c"],
        },
        **{
            name: {"dtype": kind, "shape": [1], "names": None}
            for name, kind in (("timestamp", "float32"), ("frame_index", "int64"), ("episode_index", "int64"))
        },
    }
    info = {
        "codebase_version": "v3.0", "robot_type": "so_follower", "total_episodes": len(runs), "fps": rate,
        "total_frames": sum(len(run.time) for run in runs), "chunks_size": 1000,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "features": features,
    }  # fmt: skip
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    whole: dict[str, list[object]] = {}
    for index, run in enumerate(runs):
        state = ((run.q - offset) * scale).astype(np.float32)
        own = {"action": list(state), "observation.state": list(state)}
        if effort:
            own["observation.effort"] = list(run.torque.astype(np.float32))
        own["timestamp"] = list((np.arange(len(run.time)) / rate).astype(np.float32))
        own["frame_index"], own["episode_index"] = list(range(len(run.time))), [index] * len(run.time)
        for name, values in own.items():
            whole.setdefault(name, []).extend(values)
    kinds = {
        name: pa.list_(pa.float32(), count) for name in whole if "observation" in name or name == "action"
    }
    kinds |= {"timestamp": pa.float32(), "frame_index": pa.int64(), "episode_index": pa.int64()}
    table = pa.table({name: pa.array(values, kinds[name]) for name, values in whole.items()})
    pq.write_table(table, folder / "data" / "chunk-000" / "file-000.parquet")
    places = {key: [0] * len(runs) for key in ("data/chunk_index", "data/file_index")}
    lengths = {"episode_index": list(range(len(runs))), "length": [len(run.time) for run in runs]}
    pq.write_table(pa.table({**lengths, **places}), folder / "meta/episodes/chunk-000/file-000.parquet")
    return folder
