# SPDX-License-Identifier: BSD-3-Clause
"""Logs of other programs become episodes: text tables, MATLAB, NumPy and Parquet files, ROS bags.

``pipeline`` is where ``impedance import`` begins. A map (``import_map``, read by ``map_reader``) says what a log's
columns mean; a bag or a joint recorder's file gets one made for it (``generated_maps``). A `LogTable` of any kind
(``log_sources``) is read in pieces, joined with the others, turned into joint quantities in SI units and thinned out
where asked (``convert``), searched for mistakes (``log_checks``) and written: all sources, or none. Memory does not
grow with the log's length.
"""
