# SPDX-License-Identifier: BSD-3-Clause
"""The experiments of the 2016 thesis, on top of the package: each runs tasks, measures, and writes a page."""
