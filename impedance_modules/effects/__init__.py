# SPDX-License-Identifier: BSD-3-Clause
"""Physical effects: what a robot has beyond its model, applied to plant and model or searched for in recordings."""
