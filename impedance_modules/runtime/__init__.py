# SPDX-License-Identifier: BSD-3-Clause
"""From a checked task to a safe run: control cycle, phases, supervisor, loop, record."""
