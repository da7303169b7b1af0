# SPDX-License-Identifier: BSD-3-Clause
"""What a task will do, worked out before anything moves: statics, a rehearsal, stability, energy."""
