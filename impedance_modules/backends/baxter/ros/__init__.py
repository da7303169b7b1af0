# SPDX-License-Identifier: BSD-3-Clause
"""Ways to reach ROS topics: rospy, plain sockets, or none at all for unit tests."""
