"""Contact physics and sensor models as Warp kernels; independent of devices, bytes and wall clocks."""
