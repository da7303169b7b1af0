# SPDX-License-Identifier: BSD-3-Clause
"""The next motion to record: the shortest safe one that tells the remaining causes apart."""
