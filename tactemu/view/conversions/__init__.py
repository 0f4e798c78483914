"""Converters of truth logs for other tools: Foxglove, ROS 2, Rerun, Parquet.

A run writes a log of packed messages; a converter reads it afterwards, entry by entry, so that memory does not grow
with the log. A format is one file: a class with ``begin``, ``add`` and ``finish``
(:class:`~tactemu.view.conversions.converting.Converter`), and a line in
:data:`tactemu.view.conversions.converting.CONVERTERS`. Their libraries are an extra, ``tactemu[convert]``.
"""

from tactemu.view.conversions.converting import FORMATS, convert

__all__ = ["FORMATS", "convert"]
