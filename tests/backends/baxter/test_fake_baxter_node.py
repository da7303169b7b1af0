# SPDX-License-Identifier: BSD-3-Clause
"""The double's topics, and the faults that are put on them, on nodes within this process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.simulator.build_simulator import build_fake
from impedance_modules.backends.baxter.simulator.options import FakeOptions
from impedance_modules.backends.baxter.simulator.parameters import SPRINGS
from impedance_modules.backends.baxter.simulator.simulator_node import FakeNode
from tests.support.in_process_transport import InProcessMaster, InProcessNetwork, InProcessTransport

ON = FakeOptions(enabled=True, springs=SPRINGS)


class Network:
    """A node on a network, and ears on every topic."""

    def __init__(self, options: FakeOptions = ON) -> None:
        built = build_fake("baxter", "neutral", None, options)
        self.master = InProcessMaster()
        self.robot = built.robot
        self.node = FakeNode(built.robot, InProcessNetwork(self.master), built.description)
        self.node.open()
        self.user = InProcessTransport(self.master, "/user")
        self.heard: dict[str, list] = {}

    def hear(self, topic: str, kind: type) -> list:
        return self.hear_all(topic, kind, self.heard.setdefault(topic, []))

    def hear_all(self, topic: str, kind: type, found: list) -> list:
        self.user.subscribe(topic, kind, lambda m, _: found.append(m))
        return found

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            self.node.tick()


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
    tip = hand.apply(np.array([0.0, 0.0, 0.025]))
    where = heard[-1].pose.position
    np.testing.assert_allclose([where.x, where.y, where.z], tip, atol=2e-3)
    assert sea[-1].name == net.robot.limbs["right"].limb.joint_names
    force = heard[-1].wrench.force
    assert np.linalg.norm([force.x, force.y, force.z]) < 2.0


def test_faults_of_messages() -> None:
    net = Network()
    heard = net.hear("/robot/joint_states", messages.JointState)
    fault = net.user.advertise("/fake_baxter/fault", messages.String)

    def after(words: str, seconds: float = 0.3) -> list:
        fault.send(messages.String(words))
        net.live(0.02)
        heard.clear()
        net.live(seconds)
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


def test_faults_of_nodes() -> None:
    net = Network()
    fault = net.user.advertise("/fake_baxter/fault", messages.String)

    def offers(words: str) -> list:
        fault.send(messages.String(words))
        net.live(0.01)
        return [(o.node, o.ros_type, o.problem is None) for o in net.user.offers_of("/robot/state")]

    plain = ("/realtime_loop", "baxter_core_msgs/AssemblyState", True)
    assert offers("duplicate") == [("/another_robot", plain[1], True), plain]
    assert offers("duplicate off") == [plain]
    assert offers("dead") == [plain, ("/realtime_loop_of_yesterday", None, False)]
    assert offers("dead off") == [plain]
    assert offers("wrong-md5") == [("/realtime_loop", "std_msgs/Bool", True)]
    assert offers("wrong-md5 off") == [plain]
    assert offers("restart 0.1") == []
    net.live(0.2)
    assert offers("duplicate off") == [plain] and not net.robot.machine.standing.enabled
