"""Converters of truth logs for other tools: Foxglove, ROS 2, Rerun, Parquet; and pictures of a log.

A run writes a log of packed messages; a converter reads it afterwards, entry by entry, so that memory does not grow
with the log. A format is one file, a class with ``begin``, ``add`` and ``finish``
(:class:`~tactemu.truth.conversion.Converter`), and a line in :data:`tactemu.base.formats.FORMATS`. Their libraries are
an extra, ``tactemu[convert]``.
"""
