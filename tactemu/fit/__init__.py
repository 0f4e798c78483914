"""Fits of a sensor's laws to recordings of a real one, and tests of their predictions. Needs scipy."""
