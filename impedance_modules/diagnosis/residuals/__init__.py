# SPDX-License-Identifier: BSD-3-Clause
"""Measured minus predicted torque of each recording, in one frequency band; moments of contact masked."""
