# SPDX-License-Identifier: BSD-3-Clause
"""A table that names its columns as an episode does is taken whole; what of it is not used is said."""

import json

import numpy as np
import pytest

from impedance_modules.diagnosis.data.long_recordings import read_recordings
from impedance_modules.diagnosis.text_logs import Stated, as_episodes
from tests.diagnosis.test_diagnosis import JOINTS, motion, torque
from tests.diagnosis.test_diagnosis_data import diagnose, urdf  # noqa: F401

KINDS = ("position", "velocity", "effort", "effort_command", "position_command")


def write(path, columns):
    names = ",".join(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=names, comments="")
    return path


def table(path, kind, seed, *, stiffness=(0.0, 0.0), more=()):
    """A servo that follows 20 ms late, with a stiffness that its command does not have, as a table of all kinds."""
    dice = np.random.default_rng(seed)
    t, q, v, a = motion(kind, 12.0)
    aim, effort = q + 0.02 * v, torque(q, v, a, mass=1.0)
    command = effort - np.array(stiffness) * (aim - q)
    noise = 0.02 * dice.standard_normal(effort.shape)
    values = dict(
        zip(KINDS, (q + 1e-5 * dice.standard_normal(q.shape), v, effort + noise, command, aim), strict=True)
    )
    columns = {f"{kind}.{joint}": x[:, i] for kind, x in values.items() for i, joint in enumerate(JOINTS)}
    return write(path, {"time": t, **columns, **{name: t for name in more}})


def test_every_quantity_of_an_episode_is_read_and_other_columns_are_named(tmp_path, urdf):  # noqa: F811
    path, said = table(tmp_path / "log.csv", 0, 0, more=("temperature.elbow",)), []
    stated = Stated("joint_sensor", "none")
    folder = tmp_path / "episodes"
    folder.mkdir()
    (taken,) = as_episodes([path], lambda: urdf, stated, folder, said.append)
    ((episode,),) = read_recordings([taken])
    read = np.genfromtxt(path, delimiter=",", skip_header=1)
    for place, (kind, joint) in enumerate(((kind, joint) for kind in KINDS for joint in JOINTS), start=1):
        np.testing.assert_allclose(getattr(episode, kind)[joint], read[:, place], atol=1e-12)
    assert said == [f"{path}: not imported: temperature.elbow"]


def test_a_position_loop_in_a_table_is_found_by_its_targets(tmp_path, urdf):  # noqa: F811
    paths = [table(tmp_path / f"run{i}.csv", i % 3, i, stiffness=(0.0, 8.0)) for i in range(4)]
    answer = tmp_path / "answer.json"
    code, _ = diagnose(urdf, *paths, "--effort-source", "joint_sensor", "--json", answer)
    (first,) = json.loads(answer.read_text())["causes"]
    assert code == 0 and (first["effect"], first["joints"]) == ("controller_gain", ["elbow"])
    assert first["parameters"]["elbow"]["dkp"]["value"] == pytest.approx(8.0, rel=0.1)
