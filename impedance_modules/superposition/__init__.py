# SPDX-License-Identifier: BSD-3-Clause
"""Impedances add: inertia, damping and stiffness of arms and of what they hold, and their modes."""
