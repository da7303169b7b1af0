# SPDX-License-Identifier: BSD-3-Clause
"""Shape and stiffness of a surface, from where a hand was while it pressed and how hard it pressed."""
