"""Benchmarks of this project's own machinery: `python -m benchmarks NAME`. Tests never measure speed.

pytest-benchmark and asv time a function call. Here are runs with a driver in another process, whose lateness, losses
and memory are counted, so that neither would shorten a file.
"""
