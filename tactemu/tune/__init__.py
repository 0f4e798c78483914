"""The most accurate setting that keeps a rate."""
