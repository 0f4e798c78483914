"""A DDS domain: samples of a topic, each by itself, without a speed."""

from __future__ import annotations

from firmware_protocols import Dds, WireFrame
from tactemu.wire.line import LineModel

DOMAINS = 200
"""Number of domains, from 1 on, among which tests are spread; above about 230 there are no ports left."""


class DdsLine(LineModel, connector=Dds):
    """The device writes one topic and may read another; a sample that is held back is overtaken."""

    kind = "dds"
    schemes = ("dds",)
    is_network = True
    is_byte_stream = False

    def duration_ns(self, frame: WireFrame) -> int:
        """Return 0: the time on the network is not modelled."""
        return 0

    def describe(self) -> str:
        """Return the line in words: ``DDS rt/hand/state``."""
        return f"DDS {self.connector.writes.name}"

    def usual_port(self, name: str) -> str:
        """Return the device's own domain, on this machine only."""
        return f"dds:{self.connector.domain}/{self.connector.writes.name}"

    def fresh_port(self, name: str) -> str:
        """Return a domain that depends on the process and the call; after 200 calls it repeats."""
        pid, number = self.fresh_number()
        return f"dds:{(pid * 31 + number) % DOMAINS + 1}/{self.connector.writes.name}"
