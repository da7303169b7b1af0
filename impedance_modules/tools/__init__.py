# SPDX-License-Identifier: BSD-3-Clause
"""Tools around runs and recordings: sweep, tune, surface map, roughness."""
