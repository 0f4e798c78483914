"""Datasets of many environments: shards of readings, and what the wire says of some of them."""
