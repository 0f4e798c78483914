"""AgiBot OmniHand: Pro 2025 (O12) and 2025 (O10), CAN FD.

Sources: AgibotTech/OmniHand-Pro-2025@3c7048e (src/proto.h, src/c_agibot_hand.cc:430, 1234,
src/can_bus_device/socket_can), Omnihand-2025-SDK@bcbccf4.
A reading is, for fingers 1..5 of a Pro: online, nine channels, normal (0.1 N), tangential, angle (degrees), four
proximities. For an O10: 16 values of each finger, then 25 of palm and of dorsum.

Options: pro or o10; the device's number (1 here is not from the description).
Not settled by the description: bit 7 of a question that only reads (0 here; the answer has it clear in any case); the
bytes of a question (zeros here); the padding of an answer.
"""

import struct

from host import expect, frame, open_can, run, send

PRODUCT, TACTILE = 1, 5


def ask(bus, part, device, size):
    """The first ``size`` bytes of the answer, which must come within 50 ms."""
    number = part << 24 | TACTILE << 16 | PRODUCT << 8 | device
    send(bus, number, bytes(64), extended=True, fd=True)
    message = frame(bus, lambda m: m.is_extended_id and m.arbitration_id == number, 0.05)
    expect(message.is_fd and len(message.data) >= size, f"{len(message.data)} bytes, expected {size}")
    return bytes(message.data[:size])


def read(channel, model="pro", device="1"):
    bus, number = open_can(channel), int(device, 0)
    while True:
        if model == "pro":
            fingers = [struct.unpack("<B12H4B", ask(bus, finger, number, 29)) for finger in range(1, 6)]
            expect(all(finger[10] <= 3000 for finger in fingers), "a normal force above 3000")
            yield [v for finger in fingers for v in finger]
        else:
            yield [v for part in range(1, 8) for v in ask(bus, part, number, 16 if part < 6 else 25)]


if __name__ == "__main__":
    run(read, pause=0.01)
