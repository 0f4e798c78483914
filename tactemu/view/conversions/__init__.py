"""A truth log for the tools that people have: Foxglove, ROS 2, Rerun, Parquet.

The log that a run writes keeps its packed messages; what a tool wants to see is made of them afterwards, entry by
entry, so that memory does not grow with the log. A format is one file: a class with ``begin``, ``add`` and ``finish``
(:class:`~tactemu.view.conversions.converting.Converter`), and a line in
:data:`tactemu.view.conversions.converting.CONVERTERS`. Their libraries are an extra, ``tactemu[convert]``.
"""

from tactemu.view.conversions.converting import FORMATS, convert

__all__ = ["FORMATS", "convert"]
