# SPDX-License-Identifier: BSD-3-Clause
"""Modular multi-arm impedance control with config-driven tasks."""

__version__ = "0.1.0"
