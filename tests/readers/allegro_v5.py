"""Wonik Allegro Hand V5 Sense: its touch channels, CAN.

Source: Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588 (AllegroHandDrv.cpp:417 ff., candef.h).
A reading is sixteen channels in the order of the two frames, a byte << 2, FF (invalid) as 0: before the driver's low
pass and its division by 10.

Options: whether the period is asked for first: "no", or its bytes in hex.
Not settled by the description: the data of the period command (nothing is sent, so the hand must send by itself, unless
bytes are given); which of the two frames comes first (54 here).
"""

from host import expect, frame, open_can, run, send

SENSORS = (0x54 << 2, 0x55 << 2)
PERIOD = 0x81 << 2


def read(channel, period="no"):
    bus, halves = open_can(channel), []
    if period != "no":
        send(bus, PERIOD, bytes.fromhex(period))
    while True:
        message = frame(bus, lambda m: not m.is_extended_id and m.arbitration_id in SENSORS)
        if not halves and message.arbitration_id != SENSORS[0]:
            continue  # the first sample may have begun before
        expect(message.arbitration_id == SENSORS[len(halves)], f"{message.arbitration_id:03X} twice")
        expect(len(message.data) == 8, f"{len(message.data)} bytes")
        halves.append(bytes(message.data))
        if len(halves) == len(SENSORS):
            yield [0 if byte == 0xFF else byte << 2 for byte in b"".join(halves)]
            halves = []


if __name__ == "__main__":
    run(read)
