# SPDX-License-Identifier: BSD-3-Clause
"""A real Baxter over ROS 1, and the simulator that plays it; the only place that speaks ROS."""
