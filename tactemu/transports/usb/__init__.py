"""Devices on USB, as their hosts see them: descriptors, the requests of each chip, and a USB/IP server."""
