"""Logs in ROS bags: messages that name their joints."""

from loopid.logs.bags.reader import BagReader

__all__ = ["BagReader"]
