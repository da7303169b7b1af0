# SPDX-License-Identifier: BSD-3-Clause
"""The command line; parsing, printing and exit codes, nothing else."""
