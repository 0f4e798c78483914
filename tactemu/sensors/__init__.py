"""Contact physics and sensor models as Warp kernels. Knows no device, no byte and no wall clock."""
