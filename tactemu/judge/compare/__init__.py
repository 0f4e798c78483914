"""The comparison of a real sensor with its model: ``tactemu compare``."""
