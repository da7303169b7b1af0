# SPDX-License-Identifier: BSD-3-Clause
"""A double of the robot on the built-in plant, to be talked to like the real one."""
