# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's experiments, carried out with this package: ``impedance reproduce``."""
