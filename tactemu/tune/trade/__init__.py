"""The instrument behind docs/accuracy.md: every level of fidelity against truth."""
