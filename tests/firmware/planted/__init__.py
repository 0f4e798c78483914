"""Two right devices, into which tests plant mistakes."""
