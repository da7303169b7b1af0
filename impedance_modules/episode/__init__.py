# SPDX-License-Identifier: BSD-3-Clause
"""The recording of a run: Parquet written while the run goes on, read back as numbers, shown in rerun.

Format: ``columns`` (names), ``metadata`` (robot, sensors, task), ``run_folder`` (files of a run), ``file_format``
(Parquet parts, merged at the end), ``sealed_parquet`` (checksums). Writing: ``writer`` and ``background``; a kill -9
loses at most the last second. Reading: ``reader`` gives an `Episode` (``data``); ``damage`` says what is intact of a
damaged one. Viewing: ``view_scene`` (what is shown, as plain data), ``view_layout``, ``rerun_writer``, ``live_view``,
``viewer``, ``residual_view`` (rerun) and ``run_picture`` (one PNG). Logs of other programs: ``imports``. rerun and
matplotlib are imported when first used.
"""
