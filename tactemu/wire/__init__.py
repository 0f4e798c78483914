"""Between devices and port: the line's pace, who may talk, and what goes wrong on it."""
