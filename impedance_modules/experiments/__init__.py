# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's experiments: each run by name on the framework, its numbers laid beside the printed ones."""
