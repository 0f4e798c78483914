"""Datasets of many environments: shards of readings, and wire logs of some environments."""
