# SPDX-License-Identifier: BSD-3-Clause
"""Many runs of one task with some of its numbers varied, on local cores or an existing cluster (design 3.1)."""
