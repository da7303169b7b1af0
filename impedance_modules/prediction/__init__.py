# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` and ``analyze`` foretell: statics, a quasi-static prediction, stability, energy, impedance at rest."""
