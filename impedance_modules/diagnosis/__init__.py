# SPDX-License-Identifier: BSD-3-Clause
"""Where model and recording differ, which effect is the cause, and how far the gap shrinks with it."""
