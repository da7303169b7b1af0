# SPDX-License-Identifier: BSD-3-Clause
"""ROS topics by the standard library alone: XML-RPC to find each other, TCPROS to talk."""
