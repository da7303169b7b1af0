# SPDX-License-Identifier: BSD-3-Clause
"""What is fed to the readers: for each kind of input a file that holds it, and what is done with the file.

A reader does as much with an input as a verb does before anything moves: a task is checked against its robot, a URDF
becomes a model, a log an episode. What a reader returns does not matter, only how it ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from unittest import mock

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from impedance_modules.diagnosis.data.long_recordings import read_recordings, segment_note
from impedance_modules.diagnosis.data.rigid_tree import read_tree
from impedance_modules.effects.patch_check import patch_problems
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.episode.imports.map_reader import read_map
from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.episode.metadata import METADATA_KEY
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_picture import draw_tank, draw_torque
from impedance_modules.export.mujoco_format import MUJOCO
from impedance_modules.export.patch_export import export_patch
from impedance_modules.export.urdf_format import URDF
from impedance_modules.runs.run_backends import acting_in
from impedance_modules.runs.verify import reassemble
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task_reader import read_task
from impedance_modules.spec.urdf import read_urdf
from impedance_modules.tools import sweep_plan
from impedance_modules.tools.sweep_plan import SweepPlan, make_jobs, read_range
from tests.support.import_logs import base_map, map_of
from tests.support.paths import PRESS_BOX, SIX_JOINT_PAIR

CORPUS = Path(__file__).parents[1] / "corpus"
MOST_JOBS = 5
"""Runs of a sweep that are written out."""


@dataclass(frozen=True)
class Reader:
    """One kind of input.

    Attributes:
        name: Also of the corpus' folder.
        suffix: Of its file, from the first bytes of an input.
        read: Takes the file and a folder for results.
        text: Whether inputs are text, and mutated as such.
    """

    name: str
    suffix: Callable[[bytes], str]
    read: Callable[[Path, Path], object]
    text: bool = True

    def seeds(self) -> list[bytes]:
        """The corpus: inputs that are fine, and such that once were not."""
        return [path.read_bytes() for path in sorted((CORPUS / self.name).iterdir())]


cached_robot = lru_cache(read_robot)


def _task(path: Path, _out: Path) -> None:
    read_task(path, cached_robot)


def _robot(path: Path, _out: Path) -> None:
    (path.parent / "six_joint_pair.urdf").write_bytes((SIX_JOINT_PAIR / "six_joint_pair.urdf").read_bytes())
    read_robot(path.rename(path.with_name("robot.yaml")).parent)


def _patch(path: Path, _out: Path) -> None:
    patch_problems(read_patch(path), cached_robot(SIX_JOINT_PAIR))


def _urdf(path: Path, out: Path) -> None:
    facts = read_urdf(path)
    moving = [name for name, joint in facts.joints.items() if joint.moves]
    read_tree(path, moving)
    RigidModel.from_urdf(path, moving)
    export_patch(CORPUS / "patch" / "bodies.yaml", URDF, path, out / "patched.urdf")


def _mujoco(path: Path, out: Path) -> None:
    export_patch(CORPUS / "patch" / "motors.yaml", MUJOCO, path, out / "patched.xml")


def _map(path: Path, _out: Path) -> None:
    read_map(path)


def _under(data: dict[str, object]) -> Callable[[Path, Path], object]:
    def read(path: Path, out: Path) -> object:
        mapping = path.with_name("map.yaml")
        mapping.write_text(yaml.safe_dump(data))
        return import_sources([path], mapping, None, out)

    return read


def _episode(path: Path, out: Path) -> None:
    read_episode(path)
    import_sources([path], None, None, out)


def _bag(path: Path, out: Path) -> None:
    import_sources([path], None, None, out)


@cache
def _table() -> pa.Table:
    return pq.read_table(CORPUS / "parquet" / "stock.parquet")


def _metadata(path: Path, out: Path) -> None:
    """An episode whose metadata are the input: what reads, draws, diagnoses and replays it."""
    from matplotlib.figure import Figure

    raw = path.read_bytes()
    file = path.with_name("log.parquet")
    pq.write_table(_table().replace_schema_metadata({METADATA_KEY.encode(): raw}), file)
    episode = read_episode(file)
    axes, rows = Figure().subplots(), slice(None)
    draw_torque(axes, episode, rows)
    draw_tank(axes, episode, rows)
    for (found,) in read_recordings([file]):
        segment_note(found)
    import_sources([file], None, None, out)
    reassemble(episode)
    acting_in(episode, 2)


def _sweep(path: Path, _out: Path) -> None:
    """One PATH=LO:HI[:N] a line."""
    ranges = tuple(
        read_range(line) for line in path.read_text("utf-8", "replace").split("\n") if line.strip()
    )
    with mock.patch.object(sweep_plan, "MOST_RUNS", MOST_JOBS):
        make_jobs(SweepPlan(str(PRESS_BOX), ranges, None, None, 1, 0, None, None, None))


def _of_bag(data: bytes) -> str:
    return ".bag" if data.startswith(b"#ROSBAG") else ".db3" if data.startswith(b"SQLite") else ".mcap"


def _of_arrays(data: bytes) -> str:
    return ".npz" if data.startswith(b"PK") else ".mat"


def _always(suffix: str) -> Callable[[bytes], str]:
    return lambda _: suffix


ARRAY_MAP = map_of({"position": {"columns": "q[{index}]", "unit": "rad"}}, rate=100)

READERS = {
    reader.name: reader
    for reader in (
        Reader("task", _always(".yaml"), _task),
        Reader("robot", _always(".yaml"), _robot),
        Reader("patch", _always(".yaml"), _patch),
        Reader("urdf", _always(".urdf"), _urdf),
        Reader("mujoco", _always(".xml"), _mujoco),
        Reader("map", _always(".yaml"), _map),
        Reader("csv", _always(".csv"), _under(base_map())),
        Reader("parquet", _always(".parquet"), _episode, text=False),
        Reader("bag", _of_bag, _bag, text=False),
        Reader("mat", _of_arrays, _under(ARRAY_MAP), text=False),
        Reader("sweep", _always(".txt"), _sweep),
        Reader("metadata", _always(".json"), _metadata),
    )
}
