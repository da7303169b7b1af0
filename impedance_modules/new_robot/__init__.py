# SPDX-License-Identifier: BSD-3-Clause
"""A robot folder made of a robot description: what the file knows, and what a person must fill in."""
