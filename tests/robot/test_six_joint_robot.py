# SPDX-License-Identifier: BSD-3-Clause
"""A second robot reads the same way: six joints, other names, one rigid joint, exactly mirrored."""

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.spec.robot_reader import read_robot
from tests.support.paths import SIX_JOINT_PAIR

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
FLIP = np.diag([1.0, -1.0, 1.0])
FLIP_TWIST = np.diag([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
SPEC = read_robot(SIX_JOINT_PAIR)
MODEL = pin.buildModelFromUrdf(str(SPEC.urdf))
SIGNS = np.array(list(SPEC.mirror.joint_sign.values()), dtype=float)


def indices(limb: str) -> np.ndarray:
    return np.array([MODEL.joints[MODEL.getJointId(name)].idx_v for name in SPEC.limbs[limb].joints.values()])


def mirrored_states(count: int = 200) -> list[tuple[np.ndarray, np.ndarray]]:
    """Random (q, v) whose starboard half is the mirror image of the port half."""
    rng, states = np.random.default_rng(6), []
    port, starboard = indices("port"), indices("starboard")
    for _ in range(count):
        q, v = np.zeros(MODEL.nq), np.zeros(MODEL.nv)
        q[port] = rng.uniform(MODEL.lowerPositionLimit[port], MODEL.upperPositionLimit[port])
        v[port] = rng.uniform(-1, 1, 6)
        q[starboard], v[starboard] = SIGNS * q[port], SIGNS * v[port]
        states.append((q, v))
    return states


def frame(limb: str) -> int:
    return MODEL.getFrameId(SPEC.limbs[limb].hand, pin.FrameType.BODY)


def test_reads_as_another_robot() -> None:
    assert list(SPEC.limbs) == ["port", "starboard"]
    assert [len(limb.joints) for limb in SPEC.limbs.values()] == [6, 6]
    assert SPEC.locked == {}
    rigid = [name for name, joint in SPEC.joints.items() if joint.spring_stiffness is None]
    assert rigid == ["port_turn", "starboard_turn"]
    assert (SPEC.joints["port_tilt"].position_min, SPEC.joints["starboard_tilt"].position_min) == (-0.6, -2.0)


def test_limits_mirror() -> None:
    for short, sign in SPEC.mirror.joint_sign.items():
        port, starboard = (SPEC.joints[limb.joints[short]] for limb in SPEC.limbs.values())
        mirrored = sorted((sign * port.position_min, sign * port.position_max))
        assert mirrored == [starboard.position_min, starboard.position_max]


def jacobian(data: pin.Data, q: np.ndarray, limb: str) -> np.ndarray:
    return pin.computeFrameJacobian(MODEL, data, q, frame(limb), WORLD_AXES)[:, indices(limb)]


def test_kinematics_mirror() -> None:
    data = MODEL.createData()
    for q, _ in mirrored_states():
        port, starboard = (jacobian(data, q, limb) for limb in SPEC.limbs)
        np.testing.assert_allclose(starboard * SIGNS, FLIP_TWIST @ port, atol=1e-13)


def test_dynamics_mirror() -> None:
    """Mass matrix, weight and velocity torques of the two arms differ by the signs alone."""
    data, port, starboard = MODEL.createData(), indices("port"), indices("starboard")
    for q, v in mirrored_states():
        mass = np.triu(pin.crba(MODEL, data, q))
        mass = mass + np.triu(mass, 1).T
        there = np.outer(SIGNS, SIGNS) * mass[np.ix_(starboard, starboard)]
        np.testing.assert_allclose(there, mass[np.ix_(port, port)], atol=1e-12)
        torque = pin.nonLinearEffects(MODEL, data, q, v)
        np.testing.assert_allclose(SIGNS * torque[starboard], torque[port], atol=1e-11)


def test_inertias_are_mirrored_not_equal_and_physical() -> None:
    for short in SPEC.mirror.joint_sign:
        names = (limb.joints[short] for limb in SPEC.limbs.values())
        port, starboard = (MODEL.inertias[MODEL.getJointId(name)] for name in names)
        np.testing.assert_allclose(starboard.inertia, FLIP @ port.inertia @ FLIP, atol=1e-15)
        assert np.abs(starboard.inertia - port.inertia).max() > 1e-6
        moments = np.linalg.eigvalsh(port.inertia)
        assert moments[0] > 0
        assert moments[2] < moments[0] + moments[1], short


@pytest.mark.parametrize(
    ("posture", "position", "pointing"),
    [
        ((0.13236, 0.97313, -1.85784, -1.67345, 1.65450, 0.68178), (0.45, 0.15, 0.85), (0, -1, 0)),
        ((-0.06662, -0.43404, 1.77239, 0.0, 0.23245, -0.06662), (0.45, 0.20, 0.60), (0, 0, -1)),
    ],
    ids=["hold", "wipe"],
)
def test_postures_of_the_comment(posture, position, pointing) -> None:
    """The postures that robot.yaml recommends put the palm where it says, away from singularities."""
    data, q = MODEL.createData(), np.zeros(MODEL.nq)
    q[indices("port")] = posture
    pin.framesForwardKinematics(MODEL, data, q)
    placement = data.oMf[frame("port")]
    np.testing.assert_allclose(placement.translation, position, atol=1e-4)
    np.testing.assert_allclose(placement.rotation[:, 0], pointing, atol=1e-4)
    assert np.linalg.cond(jacobian(data, q, "port")) < 15
