"""Bodies, motion, skins and scene files: what is pressed into what."""
