# SPDX-License-Identifier: BSD-3-Clause
"""Which candidates explain recordings: the regression they compete in, and the rules by which one is named."""
