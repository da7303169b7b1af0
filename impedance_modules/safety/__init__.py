# SPDX-License-Identifier: BSD-3-Clause
"""Keeps torques safe: quadratic filter (build, solve, attribute), energy tank, stop levels."""
