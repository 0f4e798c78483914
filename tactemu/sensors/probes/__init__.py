"""Levels 0 to 2: what a probe at a point feels of the bodies around it."""
