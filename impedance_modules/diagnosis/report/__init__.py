# SPDX-License-Identifier: BSD-3-Clause
"""The result as JSON, as a patch and as one HTML file that needs nothing but a browser."""
