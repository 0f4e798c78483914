"""One file, one device family."""
