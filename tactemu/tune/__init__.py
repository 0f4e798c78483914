"""Choice of the most accurate sensor setting that keeps a rate on this machine."""
