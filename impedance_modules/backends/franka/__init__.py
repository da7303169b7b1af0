# SPDX-License-Identifier: BSD-3-Clause
"""Franka arms (FR3): each is commanded by a process of its own, which answers every state of its robot."""
