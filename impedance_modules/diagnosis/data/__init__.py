# SPDX-License-Identifier: BSD-3-Clause
"""Recordings and the model they are compared with: reading, checks, even time base, folds and hold-out."""
