# SPDX-License-Identifier: BSD-3-Clause
"""A task from start to files: the robot is chosen, the loop runs, everything is recorded, summarised and verified."""
