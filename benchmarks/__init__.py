"""Benchmarks of this project's own machinery: `python -m benchmarks NAME`. Tests never measure speed."""
