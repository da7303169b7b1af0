# SPDX-License-Identifier: BSD-3-Clause
"""``python -m impedance_modules`` is the ``impedance`` command."""

from impedance_modules.cli.main import main

main()
