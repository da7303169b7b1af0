# SPDX-License-Identifier: BSD-3-Clause
"""Impedance modules: springs, joint biases, forces and dampers, and how their equilibria move."""
