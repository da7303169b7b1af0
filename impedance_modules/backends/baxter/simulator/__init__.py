# SPDX-License-Identifier: BSD-3-Clause
"""A simulator of the robot on the built-in plant, to be talked to like the real one."""
