# SPDX-License-Identifier: BSD-3-Clause
"""Robots that a task can run on: simulated, recorded, real; all behind ``protocol.Backend``."""
