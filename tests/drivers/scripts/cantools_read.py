"""``cantools_read.py DBC CHANNEL INTERFACE COUNT ASK MESSAGE...``: what cantools makes of messages of a DBC file.

Each message is waited for in turn, COUNT times. ASK is 0; or a frame as 00B#EA00, sent before each turn; or the number
of zeros that each message is asked for with, under its identifier in a CAN-FD frame.
"""

import json
import sys

import can
import cantools

dbc, channel, interface, count, ask = sys.argv[1:6]
messages = [cantools.database.load_file(dbc).get_message_by_name(name) for name in sys.argv[6:]]
first, zeros = None, b""
if "#" in ask:
    ident, data = ask.split("#")
    first = can.Message(arbitration_id=int(ident, 16), is_extended_id=False, data=bytes.fromhex(data))
else:
    zeros = bytes(int(ask))


def next_answer(bus, message):
    while True:
        answer = bus.recv(5.0)
        assert answer is not None, f"no {message.name}"
        own = bytes(answer.data) == zeros  # a multicast group hands back what was sent
        if (answer.arbitration_id, answer.is_extended_id) == (message.frame_id, message.is_extended_frame) and not own:
            return answer


readings = []
with can.Bus(interface=interface, channel=channel, fd=True) as bus:
    for _ in range(int(count)):
        readings.append([])
        if first:
            bus.send(first)
        for message in messages:
            if zeros:
                question = can.Message(
                    arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=zeros,
                    is_fd=True, bitrate_switch=True,
                )  # fmt: skip
                bus.send(question)
            readings[-1].append(message.decode(bytes(next_answer(bus, message).data), allow_truncated=True))
print(json.dumps(readings))
