"""The models of levels 0 to 2: readings of probes at points, each from the depth of the bodies around it."""
