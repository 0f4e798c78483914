"""Streams of real sensors, kept and played again."""
