"""Shapes, motions, bodies and rotations, and the Warp helpers that they share."""
