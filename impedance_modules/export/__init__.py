# SPDX-License-Identifier: BSD-3-Clause
"""Carries a patch into somebody's own simulator: into a URDF, or into a MuJoCo model."""
