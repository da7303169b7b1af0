# SPDX-License-Identifier: BSD-3-Clause
"""The fixed-rate cycle: its state, the law in the loop, phases, and the supervisor that decides what leaves."""
