# SPDX-License-Identifier: BSD-3-Clause
"""A simulated Baxter: the built-in plant with the topics, modes, time-outs and safety functions of the real robot."""
