"""What a scene needs, and why: the stages of a step, recorded once. Below physics and imperfections."""
