# SPDX-License-Identifier: BSD-3-Clause
"""MuJoCo as a simulated robot: links, drives and contact of its own, sensors and commands as the robot file says."""
