# SPDX-License-Identifier: BSD-3-Clause
"""Which effects are causes: search, significance tests, rivals, lack of fit, verdict."""
