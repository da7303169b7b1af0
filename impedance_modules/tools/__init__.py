# SPDX-License-Identifier: BSD-3-Clause
"""Tools on top of single runs: sweeps, spring tuning, surface maps, roughness of what was sanded."""
