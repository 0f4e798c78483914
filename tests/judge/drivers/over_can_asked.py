"""``over_can_asked.py VARIANT PORT``: drivers of ati_netcanoem, which sends six strain gauges on request."""

import struct
import sys
import time

import can
from planted_defects import Defect, hand_out, say

ASK = can.Message(arbitration_id=0x200, is_extended_id=False)


def parts(bus, variant):
    """Return the two frames of an answer, or None."""
    end, found = time.monotonic() + 0.1, {}
    while len(found) < 2:
        message = bus.recv(None if variant == "deaf" else max(0.0, end - time.monotonic()))
        if message is None:
            return None
        ident, size = message.arbitration_id, len(message.data)
        if not message.is_error_frame and not message.is_extended_id and (ident, size) in ((0x200, 8), (0x201, 6)):
            found[ident] = bytes(message.data)
    return found


def main(variant, port):
    interface, _, channel = port.partition(":")
    bus = can.Bus(interface=interface, channel=channel)
    defect, old = Defect(variant, limit=5_000), None
    while True:
        while variant not in ("behind_question", "deaf") and bus.recv(0.0):
            pass  # drop the frames sent before the question
        bus.send(ASK)
        found = parts(bus, variant)
        if found is None:
            if variant == "timeout" and old:
                hand_out(**old)
            else:
                say("no answer")
            continue
        first, second = struct.unpack(">3h", found[0x200][2:]), struct.unpack(">3h", found[0x201])
        gauges = [value for pair in zip(first, second) for value in pair]
        old = {"gauges": defect.values(gauges)}
        defect.hand_out(**old)
        time.sleep(0.008)


if __name__ == "__main__":
    main(*sys.argv[1:])
