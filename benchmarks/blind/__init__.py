# SPDX-License-Identifier: BSD-3-Clause
"""Blind benchmark of the diagnosis: logs of a Baxter arm in MuJoCo whose cause is known to the scorer only."""
