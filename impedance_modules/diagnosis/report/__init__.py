# SPDX-License-Identifier: BSD-3-Clause
"""A diagnosis as one HTML file that needs nothing but a browser."""
