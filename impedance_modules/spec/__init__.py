# SPDX-License-Identifier: BSD-3-Clause
"""What files say: tasks, robots and patches as frozen data, with every error located."""
