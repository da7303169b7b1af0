# SPDX-License-Identifier: BSD-3-Clause
"""The rigid-body model of a robot folder, and one control cycle's kinematics."""
