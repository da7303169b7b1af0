# SPDX-License-Identifier: BSD-3-Clause
"""How rough a surface is, judged from a hand's position and force alone (thesis 5.2.4)."""
