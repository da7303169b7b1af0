# SPDX-License-Identifier: BSD-3-Clause
"""Stages 3 and 4: columns, nuisance, noise, whitening and weighted least squares with a prior."""
