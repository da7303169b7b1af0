# SPDX-License-Identifier: BSD-3-Clause
"""Simulated reality: elastic joints, late commands, coarse sensors, contact, an object in both hands."""
