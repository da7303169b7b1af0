# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Baxter against the facts about the real robot: modes, time-outs, power, collisions, topics, faults."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.position_mode import named_posture
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.simulator.assembly_state import PowerMachine
from impedance_modules.backends.baxter.simulator.build_simulator import build_simulator
from impedance_modules.backends.baxter.simulator.fault_injection import parse_fault
from impedance_modules.backends.baxter.simulator.joint_boards import CommandMode, LimbActivity
from impedance_modules.backends.baxter.simulator.parameters import SPRINGS, STOP_MARGIN, SimulatorOptions
from impedance_modules.backends.baxter.simulator.publishers import MessageBuilder
from impedance_modules.backends.baxter.simulator.real_time import Pacer
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.backends.baxter.simulator.simulator_node import SimulatorNode
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_reader import read_robot
from tests.support.in_process_transport import InProcessMaster, InProcessNetwork, InProcessTransport

ON = SimulatorOptions(enabled=True, springs=SPRINGS)


def fake(posture: str = "neutral", **options) -> SimulatedBaxter:
    return build_simulator("baxter", posture, None, replace(ON, **options)).robot


class LeftArm:
    """The left arm of a simulated Baxter, and what happens to it."""

    def __init__(self, **options) -> None:
        self.robot = fake(**options)
        self.drive = self.robot.limbs["left"]
        self.joints, self.names = self.drive.limb.joints, self.drive.limb.joint_names
        self.start = self.robot.state.position

    def command(self, mode: CommandMode, values: Mapping[str, float] | np.ndarray) -> None:
        """One command, to the joints that are named or to all, and one tick."""
        named = values if isinstance(values, Mapping) else dict(zip(self.names, values, strict=True))
        self.robot.command("left", mode, list(named), list(named.values()))
        self.robot.tick()

    def torque(self, seconds: float, **values: float) -> None:
        """Torque for so long; none on joints that are not named."""
        for _ in range(round(seconds * 1000)):
            self.command(CommandMode.TORQUE, dict.fromkeys(self.names, 0.0) | values)

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            self.robot.tick()

    @property
    def position(self) -> np.ndarray:
        return self.robot.position(self.drive)

    @property
    def velocity(self) -> np.ndarray:
        return self.robot.state.velocity[self.joints]

    @property
    def moved(self) -> float:
        """Largest distance of any joint of the robot from its start [rad]."""
        return float(np.abs(self.robot.state.position - self.start).max())


@pytest.fixture
def arm() -> LeftArm:
    return LeftArm()


def test_no_torque_holds_the_pose_because_the_robot_carries_weight_and_springs(arm) -> None:
    arm.torque(1.0)
    assert arm.moved < 2e-3
    # What the robot adds: g(q) less what the counterbalance carries.
    sea = MessageBuilder(arm.robot).sea_joints(arm.drive.limb, 0)
    gravity, springs = sea.gravity_only[1], sea.hysteresis_model_effort[1]
    stiffness, preload = SPRINGS["s1"]
    assert gravity == pytest.approx(-47.6, abs=0.3)
    assert sea.actual_effort[1] == pytest.approx(gravity - springs, abs=0.5)
    assert springs == pytest.approx(preload + 0.55 * stiffness, abs=0.1)


def test_gravity_compensation_suppressed_lets_the_arm_fall_and_lapses(arm) -> None:
    for _ in range(150):
        arm.robot.suppressions["left"].request("suppress_gravity_compensation", arm.robot.now)
        arm.torque(0.001)
    fallen = np.abs(arm.velocity).max()
    arm.live(0.25)
    acting = arm.robot.plant.state.joints["assist"][arm.joints]
    assert fallen > 0.1 and np.abs(acting).max() > 5.0
    assert arm.moved < 1.0


@pytest.mark.parametrize("result", ["hold", "disable", "float"])
def test_silence_of_the_controller_ends_its_mode_within_the_time_out(result: str) -> None:
    arm = LeftArm(time_out_result=result)
    arm.drive.set_time_out(0.05)
    arm.torque(0.3, left_s0=6.0)
    robot, last = arm.robot, arm.robot.now
    while "no command" not in (robot.events[-1][1] if robot.events else ""):
        robot.tick()
        assert robot.now - last < 0.07
    arm.live(1.0)
    if result == "hold":
        assert arm.drive.activity is LimbActivity.HOLDS and np.abs(robot.state.velocity).max() < 0.05
    elif result == "disable":
        assert not robot.machine.state.enabled
    else:
        assert arm.drive.activity is LimbActivity.FLOATS and robot.machine.state.enabled
        # Only the motor's own friction brakes it.
        assert abs(arm.velocity[0]) > 0.05


def test_time_out_is_clipped_to_what_the_robot_accepts(arm) -> None:
    for wish, gets in ((-1.0, 0.0), (0.3, 0.3), (7.0, 1.0), (float("nan"), 1.0)):
        arm.drive.set_time_out(wish)
        assert arm.drive.time_out == gets


@pytest.mark.parametrize(
    "wish",
    [
        (CommandMode.TORQUE, ["left_s0"], [float("nan")]),
        (9, ["left_s0"], [0.0]),
        (CommandMode.TORQUE, ["left_s9"], [0.0]),
        (CommandMode.TORQUE, ["left_s0"], [0.0, 1.0]),
        (CommandMode.TORQUE, [], []),
    ],
)
def test_invalid_commands_are_ignored(arm, wish: tuple) -> None:
    arm.robot.command("left", *wish)
    assert arm.drive.ignored == 1 and arm.drive.activity is LimbActivity.HOLDS


def test_torque_beyond_the_boards_is_clamped_or_faults(arm) -> None:
    arm.robot.command("left", CommandMode.TORQUE, ["left_w2", "left_s0"], [99.0, -99.0])
    assert (min(arm.drive.command), max(arm.drive.command)) == (-50.0, 15.0)
    robot = fake(over_torque="fault")
    robot.command("left", CommandMode.TORQUE, ["left_w2"], [15.1])
    state = robot.machine.state
    assert state.stopped and state.estop_source == state.SOURCE_FAULT and not state.enabled


@pytest.mark.parametrize("mode", [CommandMode.POSITION, CommandMode.RAW_POSITION])
def test_position_modes_arrive_and_only_the_safe_one_eases(arm, mode: CommandMode) -> None:
    target = arm.position + 0.1
    for _ in range(3000):
        arm.command(mode, target)
        if arm.robot.now == 0.2:
            early = np.abs(arm.drive.reference.position - target).max()
    assert np.abs(arm.position - target).max() < 2e-3
    assert (early > 0.05) == (mode is CommandMode.POSITION)


def test_position_mode_trails_a_moving_target_as_a_real_arm_did(arm) -> None:
    start, speed = arm.position[0], 0.23
    for k in range(3000):
        arm.command(CommandMode.POSITION, {"left_s0": start + speed * k * 1e-3})
    assert start + speed * 3.0 - arm.position[0] == pytest.approx(0.094, abs=0.01)


def test_velocity_mode_runs_at_the_speed_and_stops_at_the_limit(arm) -> None:
    speeds = []
    for _ in range(4500):
        arm.command(CommandMode.VELOCITY, {"left_s0": 0.5})
        speeds.append(arm.velocity[0])
    assert np.mean(speeds[2000:2500]) == pytest.approx(0.5, abs=0.01)
    assert arm.position[0] == pytest.approx(1.70168, abs=5e-3)


def test_power_follows_the_sdk() -> None:
    machine = PowerMachine(enabled=True)
    machine.press()
    assert machine.state.estop_button == machine.state.BUTTON_PRESSED
    assert machine.state.estop_source == machine.state.SOURCE_USER
    machine.reset()
    assert machine.state.stopped and "pressed" in machine.refusal
    machine.release()
    assert machine.state.estop_button == machine.state.BUTTON_RELEASED and machine.state.stopped
    machine.enable(blocked="")
    assert not machine.state.enabled and "reset" in machine.refusal
    machine.reset()
    assert not machine.state.stopped and not machine.state.enabled
    machine.enable(blocked="")
    assert machine.state.enabled


def test_without_power_the_arm_sinks_slowly_and_ignores_commands() -> None:
    arm = LeftArm(enabled=False)
    arm.torque(1.0, left_s0=20.0)
    assert arm.drive.ignored == 1000
    assert 0.02 < arm.moved < 0.5


def test_tucked_arms_can_only_be_powered_while_their_force_field_is_suppressed() -> None:
    robot = fake("tucked", enabled=False)
    assert robot.field.near["left"] and robot.field.near["right"]
    robot.enable(True)
    assert not robot.machine.state.enabled and "force field" in robot.machine.refusal
    for limb in robot.suppressions.values():
        limb.request("suppress_collision_avoidance", robot.now)
    robot.enable(True)
    assert robot.machine.state.enabled


@pytest.mark.parametrize(("force", "kind"), [(-60.0, "impact"), (-1.0, "")])
def test_a_push_is_a_collision_if_it_is_hard(arm, force: float, kind: str) -> None:
    node = SimulatorNode(arm.robot, InProcessNetwork(InProcessMaster()), "")
    node.inject(parse_fault(f"push left 0.0 0.0 {force} 0.2", ("left", "right")))
    arm.live(0.1)
    assert arm.robot.colliding["left"] == kind
    if kind:
        arm.torque(0.5)
        assert arm.drive.activity is LimbActivity.HOLDS and arm.drive.ignored == 500
        arm.live(1.5)
        arm.torque(0.01)
        assert arm.drive.activity is LimbActivity.COMMANDED and not arm.robot.colliding["left"]


def test_a_squeezed_cuff_makes_the_arm_yield(arm) -> None:
    arm.robot.cuffs["left"] = True
    arm.torque(0.2, left_s0=20.0)
    assert arm.drive.activity is LimbActivity.FLOATS
    assert abs(arm.velocity[0]) < 0.1


def test_a_joint_driven_into_its_end_meets_a_stop(arm) -> None:
    low = arm.robot.model.column("position_min")[arm.joints[0]]
    reached = []
    for _ in range(30):
        arm.torque(0.1, left_s0=-25.0)
        reached.append(arm.robot.state.position[arm.joints[0]])
    # Without a stop 25 N.m would have turned it by tens of radians; it bounces, and comes to rest there.
    assert min(reached) > low - STOP_MARGIN - 0.1
    assert reached[-1] == pytest.approx(low - STOP_MARGIN, abs=0.03)


def test_readings_lie_on_the_grids_of_public_logs_and_are_noisy_only_if_wished() -> None:
    def readings(noise: float, seed: int) -> np.ndarray:
        robot, states = fake(noise=noise, seed=seed), []
        for _ in range(100):
            robot.tick()
            states.append(np.concatenate([robot.state.position, robot.state.effort]))
        steps = np.array(states) / np.repeat([2.0 * np.pi / 16384, 0.004], robot.model.n)
        assert np.abs(steps - np.round(steps)).max() < 1e-6
        return np.array(states)

    noisy, other, clean = readings(1, 1), readings(1, 2), readings(0, 1)
    assert (np.std(noisy, axis=0) > 3.0 * np.std(clean, axis=0)).mean() > 0.8
    assert not np.array_equal(noisy, other)


def test_a_torque_acts_after_the_transport_delay_and_not_before() -> None:
    arm = LeftArm(noise=False)
    arm.torque(0.1)
    joint, timing = arm.joints[arm.names.index("left_w1")], arm.robot.model.spec.timing
    still, moved = arm.robot.state.effort[joint], []
    for _ in range(12):
        arm.torque(0.001, left_w1=4.0)
        moved.append(abs(arm.robot.state.effort[joint] - still))
    delay = round(timing.command_delay * 1000)
    assert max(moved[:delay]) < 0.02 < 0.1 < max(moved)


def test_calibrated_mounts_are_served_and_used() -> None:
    offset = replace(ON, mount_offset={"left": (0.0, 0.001, -0.0095)})
    built = build_simulator("baxter", "neutral", None, offset)
    moved = built.robot.kinematics.pose("left_hand").translation
    plain = fake().kinematics.pose("left_hand").translation
    np.testing.assert_allclose(moved - plain, [0.0, 0.001, -0.0095], atol=2e-3)
    assert repr(0.118588 - 0.0095) in built.description


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("silense", "did you mean 'silence'"),
        ("drop 2", "valid: 0 to 1"),
        ("drop x", "'x' is not a number"),
        ("push up 1 2 3", "limbs left, right"),
        ("thing right", "valid: thing LIMB WIDTH"),
        ("gripper-error 3", "valid: gripper-error LIMB"),
        ("estop 3", "too much"),
        ("@x estop", "is not a number"),
        ("", "valid:"),
    ],
)
def test_invalid_faults_are_refused(text: str, part: str) -> None:
    with pytest.raises(BadInput, match=part.replace("(", ".")):
        parse_fault(text, ("left", "right"))


def test_postures_by_name_and_by_task() -> None:
    spec = read_robot("baxter")
    assert named_posture(spec, "untucked")["right"]["s0"] == 0.08
    assert named_posture(spec, "joint-springs")["right"]["s0"] == 0.5462
    with pytest.raises(BadInput, match="valid besides tasks: neutral, tucked, untucked"):
        named_posture(spec, "standing")


def test_pacer_has_no_drift_and_reports_its_lag() -> None:
    now = [0.0]
    pacer = Pacer(lambda: now[0], lambda s: now.__setitem__(0, now[0] + s + 3e-4))
    for _ in range(1000):
        pacer.wait()
    assert now[0] == pytest.approx(1.0, abs=1e-3) and pacer.lag == 0.0
    now[0] += 0.02
    assert pacer.wait() == 0.0
    now[0] += 1.0
    assert pacer.wait() == pytest.approx(1.02, abs=0.01)
    assert pacer.wait() == 0.0 and pacer.lag == pytest.approx(1.02, abs=0.01)


class Network:
    """A simulator on a network, and a node that can subscribe to every topic and inject faults."""

    def __init__(self, options: SimulatorOptions = ON) -> None:
        built = build_simulator("baxter", "neutral", None, options)
        master = InProcessMaster()
        self.robot = built.robot
        self.node = SimulatorNode(built.robot, InProcessNetwork(master), built.description)
        self.node.open()
        self.user = InProcessTransport(master, "/user")
        self._fault = self.user.advertise("/fake_baxter/fault", messages.String)

    def hear(self, topic: str, kind: type) -> list:
        heard: list = []
        self.user.subscribe(topic, kind, lambda message, _: heard.append(message))
        return heard

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            self.node.tick()

    def fault(self, words: str, seconds: float) -> None:
        """Injects a fault and waits."""
        self._fault.send(messages.String(words))
        self.live(seconds)


def test_two_publishers_share_the_joint_states_in_the_real_order() -> None:
    net = Network(replace(ON, head_nod=True))
    heard = net.hear("/robot/joint_states", messages.JointState)
    net.live(1.0)
    arms = [m for m in heard if "left_s0" in m.name]
    fingers = [m for m in heard if "left_s0" not in m.name]
    assert 99 <= len(arms) <= 101 and 37 <= len(fingers) <= 39
    assert arms[0].name[:4] == ("head_nod", "head_pan", "left_e0", "left_e1")
    assert all("gripper" in name for name in fingers[0].name)
    stamps = np.diff([m.header.stamp for m in arms])
    np.testing.assert_allclose(stamps, 1e7, atol=1.1e6)
    assert net.user.publishers_of("/robot/joint_states") == ("/end_effector_publisher", "/realtime_loop")
    net.user.advertise("/robot/joint_state_publish_rate", messages.UInt16).send(messages.UInt16(500))
    net.live(0.01)
    heard.clear()
    net.live(1.0)
    assert 499 <= sum("left_s0" in m.name for m in heard) <= 501


def test_endpoint_and_joints_agree_with_each_other() -> None:
    net = Network()
    heard = net.hear("/robot/limb/right/endpoint_state", messages.EndpointState)
    sea = net.hear("/robot/limb/right/gravity_compensation_torques", messages.SEAJointState)
    net.live(0.5)
    hand = net.robot.model.pose(net.robot.state.position, "right_hand")
    tip = hand.translation + 0.025 * hand.rotation[:, 2]
    where = heard[-1].pose.position
    np.testing.assert_allclose([where.x, where.y, where.z], tip, atol=2e-3)
    assert sea[-1].name == net.robot.limbs["right"].limb.joint_names
    force = heard[-1].wrench.force
    assert np.linalg.norm([force.x, force.y, force.z]) < 2.0


def test_faults_of_messages() -> None:
    net = Network()
    heard = net.hear("/robot/joint_states", messages.JointState)

    def after(words: str) -> list:
        net.fault(words, 0.02)
        heard.clear()
        net.live(0.3)
        return [m for m in heard if "left_s0" in m.name]

    assert not after("silence")
    assert len(after("silence off")) == 30
    assert len({m.header.stamp for m in after("freeze")}) == 1
    assert len({m.header.stamp for m in after("freeze off")}) == 30
    assert 5 <= len(after("drop 0.5")) <= 25
    after("drop off")
    assert np.isnan(after("nan")[0].effort).all()
    after("nan off")
    assert len(after("partial")[0].name) == len(after("partial off")[0].name) - 1
    late = after("delay 0.1")
    now = net.node._start + net.robot.now * 1e9
    assert (now - late[-1].header.stamp) * 1e-9 == pytest.approx(0.1, abs=0.02)
    after("delay off")
    before = after("silence off")[-1].header.stamp
    assert after("clock-step -3")[0].header.stamp - before < -2e9
    after("nonsense")
    assert "no fault 'nonsense'" in net.robot.events[-1][1]


def test_grippers_on_the_network_and_their_faults() -> None:
    net = Network()
    heard = net.hear(topics.gripper_state("right"), messages.EndEffectorState)
    what = net.hear(topics.gripper_properties("right"), messages.EndEffectorProperties)
    commands = net.user.advertise(topics.gripper_command("right"), messages.EndEffectorCommand)

    def after(words: str) -> list:
        net.fault(words, 0.02)
        heard.clear()
        net.live(1.0)
        return heard

    assert 37 <= len(after("thing right 0.02")) <= 39
    assert what[-1].ui_type == messages.EndEffectorProperties.ELECTRIC_GRIPPER
    assert (heard[-1].position, heard[-1].gripping, heard[-1].calibrated, heard[-1].error) == (100.0, 0, 1, 0)
    commands.send(messages.EndEffectorCommand(heard[-1].id, "go", '{"position": 0}', "me", 7))
    held = after("gripper-silent left")[-1]
    assert (held.gripping, held.moving, held.command_sender, held.command_sequence) == (1, 0, "me", 7)
    assert held.position == pytest.approx(100.0 * 0.02 / 0.044)
    commands.send(messages.EndEffectorCommand(1, "go", '{"position": 100}', "other hardware", 8))
    assert after("gripper-uncalibrated right")[-1].calibrated == 0
    assert heard[-1].command_sender == "me"
    commands.send(messages.EndEffectorCommand(heard[-1].id, "go", '{"position": 100}', "me", 9))
    assert after("thing off")[-1].gripping == 1
    commands.send(messages.EndEffectorCommand(heard[-1].id, "calibrate", "", "me", 10))
    assert after("gripper-error right")[-1].error == 1
    assert heard[-1].calibrated == 1
    assert not after("gripper-silent right")
    assert after("gripper-silent off")


def test_faults_of_nodes() -> None:
    net = Network()

    def offers(words: str) -> list:
        net.fault(words, 0.01)
        return [(o.node, o.ros_type, o.problem is None) for o in net.user.publisher_info("/robot/state")]

    plain = ("/realtime_loop", "baxter_core_msgs/AssemblyState", True)
    assert offers("duplicate") == [("/another_robot", plain[1], True), plain]
    assert offers("duplicate off") == [plain]
    assert offers("dead") == [plain, ("/realtime_loop_of_yesterday", None, False)]
    assert offers("dead off") == [plain]
    assert offers("wrong-md5") == [("/realtime_loop", "std_msgs/Bool", True)]
    assert offers("wrong-md5 off") == [plain]
    assert offers("restart 0.1") == []
    net.live(0.2)
    assert offers("duplicate off") == [plain] and not net.robot.machine.state.enabled
