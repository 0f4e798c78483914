"""``python -m firmware_protocols.check.elsewhere``: goes on from a snapshot on stdin, and prints what is sent then."""

from __future__ import annotations

import json
import sys

from firmware_protocols import registry
from firmware_protocols import state as plain
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.restarts import continued


def main() -> None:
    """A line of JSON, then the state as :func:`firmware_protocols.state.to_bytes` writes it."""
    head, _, saved = sys.stdin.buffer.read().partition(b"\n")
    header = json.loads(head)
    subject = Subject(header["target"], registry.device_class(header["target"]), header["options"])
    host = Host(subject.build())
    host.device.restore(plain.from_bytes(saved))
    host.t_ns = header["t_ns"]
    sys.stdout.write(json.dumps(continued(host, subject)))


if __name__ == "__main__":
    main()
