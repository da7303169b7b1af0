# SPDX-License-Identifier: BSD-3-Clause
"""Contact of points with compliant surfaces: geometry by coal, forces with stick-slip friction."""
