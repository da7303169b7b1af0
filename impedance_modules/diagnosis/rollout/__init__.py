# SPDX-License-Identifier: BSD-3-Clause
"""The plant simulated again from held-out states, without the causes and with them."""
