"""Benchmarks of one step, one reading and one frame."""
