# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1: messages and their wire format, the master, and nodes by plain sockets or by rospy."""
