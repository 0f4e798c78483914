"""Benchmarks: `tactemu bench NAME`. Speed is measured here, never in a timed test."""
