# SPDX-License-Identifier: BSD-3-Clause
"""Every confusable pair of the catalogue, from ambiguous to right by the motion that `impedance probe` proposes."""
