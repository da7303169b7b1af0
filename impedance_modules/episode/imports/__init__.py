# SPDX-License-Identifier: BSD-3-Clause
"""Foreign logs become episodes: text tables, MATLAB and NumPy files, ROS bags, joint recorder files.

``run`` is the door. A map (``map_reader``) says what a log's columns mean; a bag or a joint recorder's file gets
a map of its own (``sniff``). A `LogTable` of any kind (``open_table``) is read in pieces, joined with the others,
turned into joint quantities in SI units (``convert``), watched for mistakes (``clock``, ``plausible``), thinned
out where asked (``decimate``) and written: all sources, or none. Memory does not grow with the log's length.
"""
