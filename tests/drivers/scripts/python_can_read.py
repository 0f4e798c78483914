"""python-can: start a XELA board, read samples of 16 frames, stop it; interface, channel, host:port or -, samples.

A sample counts when its 16 frames follow each other: a host that is late loses frames, and joins no two samples.
"""

import json
import sys

import can

interface, channel, where, count = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
options = {"bitrate": 1_000_000}
if where != "-":
    host, _, port = where.rpartition(":")
    options = {"host": host, "port": int(port)}
samples, taxels = [], []
with can.Bus(interface=interface, channel=channel, **options) as bus:
    bus.send(can.Message(arbitration_id=0x201, data=[7, 0], is_extended_id=False))
    while len(samples) < count and (message := bus.recv(10)) is not None:
        if message.arbitration_id != 0x710 + len(taxels):
            taxels = []  # the rest of a sample that lost a frame, or the first of the next one
        if message.arbitration_id == 0x710 + len(taxels):
            taxels.append([int.from_bytes(message.data[k : k + 2], "big") for k in (1, 3, 5)])
        if len(taxels) == 16:
            samples.append(taxels)
            taxels = []
    bus.send(can.Message(arbitration_id=0x201, data=[7, 1], is_extended_id=False))
print(json.dumps(samples))
