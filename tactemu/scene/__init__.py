"""Scenes: bodies, their motions, skins on them, and scene files."""
