# SPDX-License-Identifier: BSD-3-Clause
"""The messages that Baxter and this package exchange, as plain lists of fields. Data only.

A line is ``type name`` or ``type NAME=constant``; ROS computes a message's checksum from exactly these, so a
wrong one would not connect. Compared with the checksums of real robots in ``tests/test_baxter_messages.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

FIELD_LISTS: Mapping[str, str] = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
    "std_msgs/Bool": "bool data",
    "std_msgs/Empty": "",
    "std_msgs/Float64": "float64 data",
    "std_msgs/String": "string data",
    "std_msgs/UInt16": "uint16 data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "sensor_msgs/JointState": (
        "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "baxter_core_msgs/JointCommand": (
        "int32 mode\nfloat64[] command\nstring[] names\n"
        "int32 POSITION_MODE=1\nint32 VELOCITY_MODE=2\nint32 TORQUE_MODE=3\nint32 RAW_POSITION_MODE=4"
    ),
    "baxter_core_msgs/AssemblyState": (
        "bool ready\nbool enabled\nbool stopped\nbool error\nuint8 estop_button\n"
        "uint8 ESTOP_BUTTON_UNPRESSED=0\nuint8 ESTOP_BUTTON_PRESSED=1\n"
        "uint8 ESTOP_BUTTON_UNKNOWN=2\nuint8 ESTOP_BUTTON_RELEASED=3\n"
        "uint8 estop_source\n"
        "uint8 ESTOP_SOURCE_NONE=0\nuint8 ESTOP_SOURCE_USER=1\nuint8 ESTOP_SOURCE_UNKNOWN=2\n"
        "uint8 ESTOP_SOURCE_FAULT=3\nuint8 ESTOP_SOURCE_BRAIN=4"
    ),
    "baxter_core_msgs/SEAJointState": (
        "Header header\nstring[] name\nfloat64[] commanded_position\nfloat64[] commanded_velocity\n"
        "float64[] commanded_acceleration\nfloat64[] commanded_effort\nfloat64[] actual_position\n"
        "float64[] actual_velocity\nfloat64[] actual_effort\nfloat64[] gravity_model_effort\n"
        "float64[] gravity_only\nfloat64[] hysteresis_model_effort\nfloat64[] crosstalk_model_effort\n"
        "float64 hystState"
    ),
    "baxter_core_msgs/EndpointState": (
        "Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\ngeometry_msgs/Wrench wrench"
    ),
    "baxter_core_msgs/DigitalIOState": (
        "int8 state\nbool isInputOnly\nint8 OFF=0\nint8 ON=1\nint8 PRESSED=1\nint8 UNPRESSED=0"
    ),
    "baxter_core_msgs/CollisionAvoidanceState": (
        "std_msgs/Header header\nbool other_arm\nstring[] collision_object"
    ),
    "baxter_core_msgs/CollisionDetectionState": "std_msgs/Header header\nbool collision_state",
    "baxter_core_msgs/HeadState": "float32 pan\nbool isTurning\nbool isNodding\nbool isPanEnabled",
    "baxter_core_msgs/EndEffectorState": (
        "time timestamp\nuint32 id\nuint8 enabled\nuint8 calibrated\nuint8 ready\nuint8 moving\n"
        "uint8 gripping\nuint8 missed\nuint8 error\nuint8 reverse\nfloat32 position\nfloat32 force\n"
        "string state\nstring command\nstring command_sender\nuint32 command_sequence\n"
        "uint8 STATE_FALSE=0\nuint8 STATE_TRUE=1\nuint8 STATE_UNKNOWN=2\n"
        "float32 POSITION_CLOSED=0.0\nfloat32 POSITION_OPEN=100.0\n"
        "float32 FORCE_MIN=0.0\nfloat32 FORCE_MAX=100.0"
    ),
    "baxter_core_msgs/URDFConfiguration": "time time\nstring link\nstring joint\nstring urdf",
}
"""Type -> its fields and constants, in the order in which ROS puts them on the wire."""
