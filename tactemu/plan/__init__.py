"""The plan of a scene: the stages of a step, each with its reason, recorded once. It lies below sensors and
imperfections."""
