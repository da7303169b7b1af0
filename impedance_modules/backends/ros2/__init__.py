# SPDX-License-Identifier: BSD-3-Clause
"""Robots on ROS 2: states by ``/joint_states``, torques to effort controllers, by a node in a process of its own."""
