# SPDX-License-Identifier: BSD-3-Clause
"""Posture and joint stiffness with which an arm carries a force without folding (thesis 6.2.2)."""
