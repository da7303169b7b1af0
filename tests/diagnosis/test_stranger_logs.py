# SPDX-License-Identifier: BSD-3-Clause
"""Strangers' logs, each from the file that its maker's software writes to a verdict, or a refusal that teaches."""

import importlib.metadata
import json
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import scipy.io
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from impedance_modules.episode.imports.lerobot_dataset import LeRobotTable
from impedance_modules.episode.reader import read_episode
from tests.support.commands import invoke, refusal
from tests.support.import_logs import Bag, write_table
from tests.support.stranger_logs import (
    Run,
    swinging,
    with_torque,
    write_franka,
    write_lerobot,
    write_rtde,
)

SHOULDER = ("shoulder", "elbow")
ARM = """<robot name="stranger"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.02 0 -0.2" rpy="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.03" ixy="0" ixz="0.001" iyy="0.03" iyz="0" izz="0.01"/></inertial>
<collision><geometry><mesh filename="package://stranger_description/meshes/upper.stl"/></geometry></collision></link>
<link name="elbow"><inertial><origin xyz="0 0.01 -0.15"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="elbow"/><origin xyz="0 0 -0.4"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="9" effort="50"/></joint></robot>"""
"""As makers ship them: a joint and a link of one name, a continuous joint, a mesh that is not there."""

FRICTION = 0.3
"""Viscous friction of the elbow that the recordings have and the description lacks [N.m.s/rad]."""


def rubbing(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return FRICTION * v * (np.arange(v.shape[1]) == v.shape[1] - 1)


def arm_runs(*, rate: float = 100.0, seconds: float = 12.0, about: float = 0.0, law=rubbing) -> list[Run]:
    model = pin.buildModelFromXML(ARM)
    made = [swinging(kind, 2, seconds=seconds, rate=rate) for kind in range(3)]
    return [with_torque(run, model, SHOULDER, law, about=np.array([about, 0.0])) for run in made]


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "stranger.urdf"
    path.write_text(ARM)
    return path


def base_map(**more: object) -> dict[str, object]:
    about = {"format": 1, "robot": "stranger", "urdf": "stranger.urdf", "joints": list(SHOULDER)}
    return {**about, "effort_source": "joint_sensor", "gravity_compensation": "none", **more}


def write_map(folder: Path, data: dict[str, object]) -> Path:
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def verdict(folder: Path, urdf: Path, *more: object) -> dict:
    """What is found in the episodes of ``folder/out``."""
    invoke("diagnose", folder / "out", "--urdf", urdf, "--json", folder / "answer.json", *more)
    return json.loads((folder / "answer.json").read_text())


def rubs(found: dict, joint: str = "elbow") -> None:
    """The friction is the first cause, with its number."""
    first = found["causes"][0]
    assert (first["effect"], first["joints"]) == ("viscous_friction", [joint]), found["causes"]
    assert first["parameters"][joint]["fv"]["value"] == pytest.approx(FRICTION, rel=0.1)


# --- makers' own logs --------------------------------------------------------------------------------------


def panda() -> Path:
    robots = "cmeel.prefix/share/example-robot-data/robots"
    package = importlib.metadata.distribution("example-robot-data")
    return Path(str(package.locate_file(f"{robots}/panda_description/urdf/panda.urdf")))


ABOUT = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.8, 0.5])
PANDA = [f"panda_joint{index}" for index in range(1, 8)]


@pytest.mark.long
def test_libfrankas_log_needs_the_description_alone(tmp_path):
    model = pin.buildModelFromUrdf(str(panda()))
    files = []
    for kind in range(3):
        run = swinging(kind, 7, seconds=10.0, rate=200.0, size=0.25)
        run = with_torque(run, model, PANDA, lambda q, v, tau: 0.8 * v * (np.arange(7) == 3), about=ABOUT)
        files.append(write_franka(tmp_path / f"run{kind}.csv", run, spaced=kind == 0))
    said = invoke("import", *files, "--urdf", panda(), "--out", tmp_path / "out").output
    assert "a log of libfranka" in said and "torque was not commanded" in said
    found = verdict(tmp_path, panda())
    first = found["causes"][0]
    assert (first["effect"], first["joints"]) == ("viscous_friction", ["panda_joint4"])
    assert first["parameters"]["panda_joint4"]["fv"]["value"] == pytest.approx(0.8, rel=0.05)


@pytest.mark.parametrize("spaced", [True, False])
def test_libfrankas_log_is_read_as_its_maker_documents_it(tmp_path, spaced):
    run = swinging(0, 7, seconds=1.0, rate=1000.0)
    run = Run(run.time, run.q + ABOUT, run.v, run.a, np.cos(3.0 * run.q))
    log = write_franka(tmp_path / "run.csv", run, spaced=spaced, command=True)
    assert "names of its 7 joints" in refusal("import", log, "--out", tmp_path / "out")
    invoke("import", log, "--urdf", panda(), "--out", tmp_path / "out")
    episode = read_episode(tmp_path / "out" / "run.parquet")
    assert list(episode.joints) == PANDA
    assert (episode.effort_source, episode.gravity_compensation) == ("joint_sensor", "robot")
    np.testing.assert_allclose(episode.time - episode.time[0], run.time, atol=1e-9)
    for kind, expected in (("position", run.q), ("velocity", run.v), ("effort", run.torque)):
        np.testing.assert_allclose(episode.matrix(kind), expected, atol=1e-7)
    np.testing.assert_allclose(episode.matrix("effort_command"), run.torque, atol=1e-7)


@pytest.mark.parametrize("separator", [",", " "])
def test_currents_ask_for_their_constant_and_are_torques_with_it(tmp_path, urdf, separator):
    ampere = np.array([12.5, 8.0])
    logs = [
        write_rtde(tmp_path / f"run{index}.csv", run, ampere, separator)
        for index, run in enumerate(arm_runs(rate=125.0))
    ]
    said = refusal("import", *logs, "--urdf", urdf, "--out", tmp_path / "out")
    assert "the torque at the joint for one ampere" in said and "--write-map" in said
    assert not (tmp_path / "out").exists()
    target = tmp_path / "map.yaml"
    printed = invoke("import", logs[0], "--urdf", urdf, "--write-map", target).output
    assert "to be stated in it: 'gain' of actual_current" in printed
    said = refusal("import", *logs, "--map", target, "--out", tmp_path / "out")
    assert f"{target}:" in said and "gain" in said  # with its line
    text = target.read_text().replace('"shoulder": "STATE"', '"shoulder": 12.5')
    target.write_text(text.replace('"elbow": "STATE"', '"elbow": 8.0'))
    invoke("import", *logs, "--map", target, "--out", tmp_path / "out")
    assert read_episode(tmp_path / "out" / "run0.parquet").effort_source == "motor"
    rubs(verdict(tmp_path, urdf))


# --- LeRobot -----------------------------------------------------------------------------------------------


def lerobot_map(**position: object) -> dict[str, object]:
    return base_map(
        tables=[
            {
                "time": {"column": "timestamp", "unit": "s"},
                "position": {"columns": "observation.state.{joint}.pos", **position},
                "effort": {"columns": "observation.effort.{joint}", "unit": "N.m"},
            }
        ]
    )


def test_a_lerobot_dataset_asks_for_its_units(tmp_path, urdf):
    runs = arm_runs(rate=50.0, seconds=16.0)
    dataset = write_lerobot(tmp_path / "set", runs, SHOULDER, rate=50.0, scale=180.0 / np.pi)
    said = refusal("import", dataset, "--out", tmp_path / "out")
    assert "units of its numbers" in said and "'effort_source'" in said and "--write-map" in said
    target = tmp_path / "map.yaml"
    invoke("import", dataset, "--urdf", urdf, "--write-map", target)
    said = refusal("import", dataset, "--map", target, "--out", tmp_path / "out")
    assert f"{target}:8:" in said and f"{target}:9:" in said and "joint_sensor, motor" in said
    stated = target.read_text().replace("effort_source: STATE", "effort_source: motor")
    stated = stated.replace("gravity_compensation: STATE", "gravity_compensation: none")
    target.write_text(stated)
    said = refusal("import", dataset, "--map", target, "--out", tmp_path / "out")
    lines = [number for number, row in enumerate(stated.splitlines(), 1) if "unit: STATE" in row]
    assert len(lines) == 3 and all(f"{target}:{line}:" in said for line in lines) and "normalised" in said
    rows = [row.replace("STATE", "N.m" if "effort:" in row else "deg") for row in stated.splitlines()]
    target.write_text("\n".join(row for row in rows if "position_command" not in row) + "\n")
    invoke("import", dataset, "--map", target, "--out", tmp_path / "out")
    episode = read_episode(tmp_path / "out" / "set-episode_000001.parquet")
    np.testing.assert_allclose(episode.matrix("position"), runs[1].q, atol=1e-5)
    rubs(verdict(tmp_path, urdf))


def test_normalised_positions_need_the_calibrated_range(tmp_path, urdf):
    runs = arm_runs(rate=50.0)
    dataset = write_lerobot(tmp_path / "set", runs, SHOULDER, rate=50.0, scale=100.0 / 1.9, offset=0.2)
    said = refusal(
        "import",
        dataset,
        "--map",
        write_map(tmp_path, lerobot_map(unit="normalised")),
        "--out",
        tmp_path / "out",
    )
    assert "missing the range of shoulder, elbow" in said and "map.yaml:" in said
    ends = {joint: [0.2 - 1.9, 0.2 + 1.9] for joint in SHOULDER}
    target = write_map(tmp_path, lerobot_map(unit="normalised", range=ends))
    invoke("import", dataset / "episode_000002", "--map", target, "--out", tmp_path / "out")
    episode = read_episode(tmp_path / "out" / "set-episode_000002.parquet")
    np.testing.assert_allclose(episode.matrix("position"), runs[2].q, atol=1e-5)


def test_a_lerobot_dataset_without_torque_is_no_cause_for_a_guess(tmp_path, urdf):
    runs = arm_runs(rate=50.0)
    dataset = write_lerobot(tmp_path / "set", runs, SHOULDER, rate=50.0, scale=1.0, effort=False)
    data = lerobot_map(unit="rad")
    del data["tables"][0]["effort"], data["effort_source"]
    invoke("import", dataset, "--map", write_map(tmp_path, data), "--out", tmp_path / "out")
    found = verdict(tmp_path, urdf)
    assert found["verdict"] == "insufficient_data" and "no torque was recorded" in found["data"]["reason"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda info: info.update(codebase_version="v1.6"), "version 'v1.6'"),
        (lambda info: info.update(data_path="../../secret.parquet"), "'../../secret.parquet'"),
        (lambda info: info.pop("features"), "no description of a LeRobot dataset"),
        (lambda info: info["features"]["observation.state"].update(shape=[10**9]), "entries"),
        (lambda info: info.update(total_episodes=7), "does not say where it is"),
    ],
)
def test_a_spoiled_dataset_is_refused(tmp_path, urdf, spoil, words):
    dataset = write_lerobot(tmp_path / "set", arm_runs(rate=50.0), SHOULDER, rate=50.0, scale=1.0)
    info = json.loads((dataset / "meta" / "info.json").read_text())
    spoil(info)
    (dataset / "meta" / "info.json").write_text(json.dumps(info))
    target = write_map(tmp_path, lerobot_map(unit="rad"))
    assert words in refusal("import", dataset, "--map", target, "--out", tmp_path / "out")


def test_a_dataset_cut_into_pieces_gives_every_frame_once(tmp_path):
    """Whatever file an episode stands in, its rows are those with its number, in order."""
    runs = arm_runs(rate=50.0, seconds=4.0)
    dataset = write_lerobot(tmp_path / "set", runs, SHOULDER, rate=50.0, scale=1.0)
    for index, run in enumerate(runs):
        table = LeRobotTable(dataset / f"episode_{index:06d}")
        (chunk,) = table.chunks(["observation.state.elbow.pos", "timestamp"])
        np.testing.assert_allclose(chunk.columns["observation.state.elbow.pos"], run.q[:, 1], atol=1e-6)
        assert len(chunk) == len(run.time)


# --- ROS, and one that is none ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_ros_recordings_of_a_strangers_robot(tmp_path, urdf, kind):
    """A gripper speaks on the same topic; continuous joints wrap at half a turn, as drivers report them."""
    logs = []
    for index, run in enumerate(arm_runs(about=2.9)):
        bag = Bag()
        wrapped = np.angle(np.exp(1j * run.q))
        for row, stamp in enumerate(run.time):
            state = {
                "position": wrapped[row, ::-1],
                "velocity": run.v[row, ::-1],
                "effort": run.torque[row, ::-1],
            }
            bag.state("/arm/joint_states", stamp, SHOULDER[::-1], **state)
            bag.state("/arm/joint_states", stamp + 1e-3, ["finger"], position=[0.01])
        logs.append(bag.write(tmp_path / f"run{index}", kind))
    said = refusal("import", *logs, "--out", tmp_path / "out")
    assert "no joint states of a shipped robot" in said and "/arm/joint_states: elbow" in said
    pattern = "/arm/joint_states.{}.{{joint}}"
    units = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
    table = {
        quantity: {"columns": pattern.format(quantity), "unit": unit} for quantity, unit in units.items()
    }
    invoke("import", *logs, "--map", write_map(tmp_path, base_map(tables=[table])), "--out", tmp_path / "out")
    found = verdict(tmp_path, urdf)
    rubs(found)
    assert any("wraps around after a turn; unwrapped" in warning for warning in found["data"]["warnings"])


def test_a_bag_without_joints_says_what_it_holds(tmp_path, urdf):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "log", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/torque", "std_msgs/msg/Float64MultiArray", typestore=store)
        layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        message = store.types["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.ones(2))
        for stamp in range(20):
            raw = store.serialize_cdr(message, "std_msgs/msg/Float64MultiArray")
            writer.write(topic, 10**9 + stamp * 10**7, raw)
    said = refusal("import", tmp_path / "log", "--out", tmp_path / "out")
    assert "no message about joints" in said and "Float64MultiArray" in said


# --- gears, slides, simulators -------------------------------------------------------------------------------


def matlab_logs(folder: Path, ratio: np.ndarray) -> list[Path]:
    """Positions of the motors in counts, and their torques, in a MATLAB file."""
    logs = []
    for index, run in enumerate(arm_runs()):
        counts = np.round(run.q * ratio * 65536 / (2.0 * np.pi))
        path = folder / f"run{index}.mat"
        scipy.io.savemat(path, {"t": run.time, "enc": counts, "tau": run.torque / ratio})
        logs.append(path)
    return logs


def gear_map(**more: object) -> dict[str, object]:
    side = {"side": "motor"} if "transmission" in more else {}
    table = {
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": "enc[{index}]", "unit": "counts", "counts_per_rev": 65536, **side},
        "effort": {"columns": "tau[{index}]", "unit": "N.m", **side},
    }
    return base_map(effort_source="motor", tables=[table], **more)


def test_motors_behind_a_gear_are_carried_to_the_joints_or_refused(tmp_path, urdf):
    ratio = np.array([50.0, -80.0])
    logs = matlab_logs(tmp_path, ratio)
    said = refusal("import", *logs, "--map", write_map(tmp_path, gear_map()), "--out", tmp_path / "out")
    assert "its range is" in said and "transmission" in said
    good = gear_map(transmission={"ratio": ratio.tolist()})
    invoke("import", *logs, "--map", write_map(tmp_path, good), "--out", tmp_path / "out")
    rubs(verdict(tmp_path, urdf))


def test_a_motors_torque_without_its_gear_is_no_effect(tmp_path, urdf):
    """Positions at the joint, torque before the gear: nothing in the catalogue is a factor of eighty."""
    for index, run in enumerate(arm_runs()):
        columns = ["t", "q1", "q2", "i1", "i2"]
        write_table(tmp_path / f"run{index}.csv", columns, run.time, run.q, run.torque / 80.0)
    table = {
        "separator": "comma",
        "header": True,
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": "q{index}", "unit": "rad"},
        "effort": {"columns": "i{index}", "unit": "N.m"},
    }
    logs = sorted(tmp_path.glob("*.csv"))
    data = base_map(effort_source="motor", tables=[table])
    invoke("import", *logs, "--map", write_map(tmp_path, data), "--out", tmp_path / "out")
    said = refusal("diagnose", tmp_path / "out", "--urdf", urdf)
    assert "gear" in said and "valid:" in said


def test_a_low_pass_sees_no_turns(tmp_path, urdf):
    """An angle that is counted from zero again after each turn is made whole before samples are left out."""
    time = np.arange(3000) / 1000.0
    angle = 4.0 * np.sin(0.8 * time) + 1.0
    q = np.column_stack([np.angle(np.exp(1j * angle)), 0.3 * np.sin(time)])
    write_table(tmp_path / "run.csv", ["t", "q1", "q2"], time, q, form="%.12g")
    table = {"separator": "comma", "header": True, "time": {"column": "t", "unit": "s"}}
    table["position"] = {"columns": "q{index}", "unit": "rad"}
    data = base_map(tables=[table], decimate={"keep_every": 10, "low_pass": 20})
    del data["effort_source"]
    target = write_map(tmp_path, data)
    said = invoke("import", tmp_path / "run.csv", "--map", target, "--out", tmp_path / "out").output
    assert "position.shoulder jumps by a turn" in said
    found = read_episode(tmp_path / "out" / "run.parquet")
    np.testing.assert_allclose(found.position["shoulder"][20:-20], angle[::10][20:-20], atol=1e-4)


GANTRY = """<robot name="gantry"><link name="base"/><link name="carriage"><inertial><mass value="6"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" velocity="3" effort="400"/></joint>
<link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="carriage"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


def test_a_slide_has_newtons_and_metres_from_the_file_to_the_report(tmp_path):
    model = pin.buildModelFromXML(GANTRY)
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    dry = 4.0
    for kind in range(3):
        run = swinging(kind, 2, seconds=12.0, rate=100.0)
        run = with_torque(
            run, model, ["rail", "swing"], lambda q, v, tau: dry * np.sign(v) * np.array([1.0, 0.0])
        )
        columns = [run.time, 1e3 * run.q[:, 0], run.q[:, 1] * 180.0 / np.pi, run.torque]
        header = ["t", "x", "phi", "F", "tau"]
        write_table(tmp_path / f"run{kind}.csv", header, *columns, separator=";")
    table = {
        "separator": "semicolon",
        "header": True,
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": ["x", "phi"], "unit": {"rail": "mm", "swing": "deg"}},
        "effort": {"columns": ["F", "tau"], "unit": {"rail": "N", "swing": "N.m"}},
    }
    data = base_map(tables=[table], urdf="gantry.urdf", joints=["rail", "swing"])
    logs = sorted(tmp_path.glob("*.csv"))
    invoke("import", *logs, "--map", write_map(tmp_path, data), "--out", tmp_path / "out")
    found = verdict(tmp_path, tmp_path / "gantry.urdf", "--report", tmp_path / "report.html")
    first = found["causes"][0]
    assert (first["effect"], first["joints"]) == ("coulomb_friction", ["rail"])
    assert first["parameters"]["rail"]["fc"]["value"] == pytest.approx(dry, rel=0.05)
    assert first["parameters"]["rail"]["fc"]["unit"] == "N"
    assert found["gap"]["per_joint"]["rail"]["unit"] == "N"
    assert found["gap"]["rollout"]["per_joint"]["rail"]["position"]["unit"] == "m"
    assert found["gap"]["rollout"]["per_joint"]["rail"]["velocity"]["unit"] == "m/s"
    page = (tmp_path / "report.html").read_text()
    assert "rail, link [N]" in page and "rail, link [N.m]" not in page


MODEL = """<mujoco model="bench"><compiler angle="degree"/><option timestep="0.0005"/>
  <default><joint axis="0 1 0" damping="0.2" armature="0.05"/></default>
  <worldbody><body name="upper"><joint name="shoulder" range="-170 170"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" mass="2"/>
    <body name="fore" pos="0 0 -0.4"><joint name="elbow" range="-170 170" damping="{damping}"/>
      <inertial pos="0 0.01 -0.15" mass="1" diaginertia="0.01 0.01 0.005"/></body></body></worldbody>
  <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""


def test_a_mujoco_model_against_what_mujoco_recorded(tmp_path):
    """The XML has armature and damping, which are no gap; the bench has more damping than it says."""
    (tmp_path / "bench.xml").write_text(MODEL.format(damping=0.2))
    model = mujoco.MjModel.from_xml_string(MODEL.format(damping=0.2 + FRICTION))
    data = mujoco.MjData(model)
    for number, kind in enumerate((0, 1, 2, 0)):
        wanted, rows = swinging(kind, 2, seconds=12.0, rate=2000.0), []
        data.qpos[:], data.qvel[:] = wanted.q[0], wanted.v[0]
        for row in range(len(wanted.time)):
            data.qpos[:], data.qvel[:], data.qacc[:] = wanted.q[row], wanted.v[row], wanted.a[row]
            if row % 20 == 0:
                mujoco.mj_inverse(model, data)
                rows.append([data.qpos.copy(), data.qfrc_inverse.copy()])
        q, torque = (np.array(column) for column in zip(*rows, strict=True))
        dice = np.random.default_rng(number)
        torque += dice.normal(scale=0.02, size=torque.shape)
        q += dice.normal(scale=1e-5, size=q.shape)
        np.savez(tmp_path / f"run{number}.npz", qpos=q, qfrc_actuator=torque)
    table = {"position": {"columns": "qpos[{index}]", "unit": "rad"}}
    table["effort"] = {"columns": "qfrc_actuator[{index}]", "unit": "N.m"}
    about = base_map(tables=[table], urdf="bench.xml", rate=100, effort_source="motor")
    about["repeats"] = [["run0", "run3"]]
    logs = sorted(tmp_path.glob("*.npz"))
    invoke("import", *logs, "--map", write_map(tmp_path, about), "--out", tmp_path / "out")
    found = verdict(tmp_path, tmp_path / "bench.xml")
    rubs(found)
    assert found["verdict"] == "explained" and len(found["causes"]) == 1
    assert any("part of the model is its armature" in said for said in found["data"]["warnings"])


# --- one arm of several ---------------------------------------------------------------------------------------


def test_one_arm_of_two_on_a_column_that_was_not_recorded(tmp_path):
    """The column leans by 0.4 rad, which nobody recorded: with --hold the recordings agree, without it they do not."""
    links = "".join(
        ARM[ARM.index('<link name="upper"') : ARM.index("</robot>")]
        .replace('name="', f'name="{side}_')
        .replace('link="', f'link="{side}_')
        .replace(f'"{side}_base"', '"chest"')
        for side in ("left", "right")
    )
    text = (
        '<robot name="two"><link name="base"/><link name="chest"/><joint name="lean" type="revolute">'
        '<parent link="base"/><child link="chest"/><axis xyz="0 1 0"/>'
        f'<limit lower="-1" upper="1" velocity="1" effort="9"/></joint>{links}</robot>'
    )
    (tmp_path / "two.urdf").write_text(text)
    model = pin.buildModelFromXML(text)
    stood = pin.neutral(model)
    stood[model.joints[model.getJointId("lean")].idx_q] = 0.4
    leaning = pin.buildReducedModel(model, [model.getJointId("lean")], stood)
    names = ["left_shoulder", "left_elbow"]
    for kind in range(3):
        run = with_torque(swinging(kind, 2, seconds=12.0, rate=100.0), leaning, names, rubbing)
        write_table(tmp_path / f"run{kind}.csv", ["t", "q1", "q2", "f1", "f2"], run.time, run.q, run.torque)
    table = {
        "separator": "comma",
        "header": True,
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": "q{index}", "unit": "rad"},
        "effort": {"columns": "f{index}", "unit": "N.m"},
    }
    data = base_map(tables=[table], urdf="two.urdf", joints=names)
    logs = sorted(tmp_path.glob("*.csv"))
    invoke("import", *logs, "--map", write_map(tmp_path, data), "--out", tmp_path / "out")
    found = verdict(tmp_path, tmp_path / "two.urdf", "--hold", "lean=0.4")
    rubs(found, "left_elbow")
    assert len(found["causes"]) == 1
    said = " ".join(found["data"]["warnings"])
    assert "held where it was stated: lean at 0.4 rad" in said and "right_shoulder, right_elbow" in said
    unsaid = verdict(tmp_path, tmp_path / "two.urdf")
    assert "assumed fixed at 0: lean" in " ".join(unsaid["data"]["warnings"])
    assert unsaid["causes"][0]["effect"] != "viscous_friction"
