# SPDX-License-Identifier: BSD-3-Clause
"""Physical effects that the plant and the model can wear."""
