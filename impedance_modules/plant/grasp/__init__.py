# SPDX-License-Identifier: BSD-3-Clause
"""A rigid object and the stiff couplings by which hands hold it."""
