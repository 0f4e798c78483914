"""The measurement behind docs/accuracy.md: the error and the cost of every level of fidelity."""
