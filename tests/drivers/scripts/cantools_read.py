"""``cantools_read.py DBC CHANNEL INTERFACE COUNT SIZE MESSAGE...``: what cantools makes of messages of a DBC file.

Each message is waited for in turn, COUNT times. Where SIZE is not 0, it is first asked for: that many zeros under its
identifier, in a CAN-FD frame.
"""

import json
import sys

import can
import cantools

dbc, channel, interface, count, size = sys.argv[1:6]
messages = [cantools.database.load_file(dbc).get_message_by_name(name) for name in sys.argv[6:]]
request = bytes(int(size))


def next_answer(bus, message):
    while True:
        answer = bus.recv(5.0)
        assert answer is not None, f"no {message.name}"
        own = bytes(answer.data) == request  # a multicast group hands back what was sent
        if (answer.arbitration_id, answer.is_extended_id) == (message.frame_id, message.is_extended_frame) and not own:
            return answer


readings = []
with can.Bus(interface=interface, channel=channel, fd=True) as bus:
    for _ in range(int(count)):
        readings.append([])
        for message in messages:
            if request:
                question = can.Message(
                    arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=request,
                    is_fd=True, bitrate_switch=True,
                )  # fmt: skip
                bus.send(question)
            readings[-1].append(message.decode(bytes(next_answer(bus, message).data)))
print(json.dumps(readings))
