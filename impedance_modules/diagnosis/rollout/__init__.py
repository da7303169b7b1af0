# SPDX-License-Identifier: BSD-3-Clause
"""Held-out recordings lived through again by the plant, from measured states, without and with the causes."""
