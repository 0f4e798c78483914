"""``cantools_ask.py DBC CHANNEL INTERFACE COUNT SIZE MESSAGE...``: ask for each message of a DBC file over CAN-FD.

A request is SIZE zeros under the identifier of the message; what comes back is decoded by cantools.
"""

import json
import sys

import can
import cantools

dbc, channel, interface, count, size = sys.argv[1:6]
messages = [cantools.database.load_file(dbc).get_message_by_name(name) for name in sys.argv[6:]]
readings = []
with can.Bus(interface=interface, channel=channel, fd=True) as bus:
    for _ in range(int(count)):
        readings.append([])
        for message in messages:
            request = can.Message(
                arbitration_id=message.frame_id,
                is_extended_id=message.is_extended_frame,
                is_fd=True,
                bitrate_switch=True,
                data=bytes(int(size)),
            )
            bus.send(request)
            while True:
                answer = bus.recv(2.0)
                assert answer is not None, f"no answer to {message.name}"
                # A multicast group hands back what was sent, too.
                if answer.arbitration_id == message.frame_id and bytes(answer.data) != bytes(int(size)):
                    break
            assert answer.is_fd and answer.is_extended_id == message.is_extended_frame
            readings[-1].append(message.decode(bytes(answer.data)))
print(json.dumps(readings))
