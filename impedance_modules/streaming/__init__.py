# SPDX-License-Identifier: BSD-3-Clause
"""Set-points that arrive while a task runs: messages, who may send them, which of them count, over which wire."""
