# SPDX-License-Identifier: BSD-3-Clause
"""A real Baxter over ROS 1 (driver, ``ros``), and a simulated one (``simulator``); the only place that speaks ROS."""
