"""inspire-rh56dftp over Modbus TCP: all batches of the touch map, 200 times each, as its scheduler does, and a move."""

import json
import sys
import time

from inspire_rh56dftp import InspireHand
from inspire_rh56dftp.registers import ANGLE_ACT, TACTILE_READ_BATCHES

host, _, port = sys.argv[1].partition(":")
hand = InspireHand(ip=host, port=int(port), unit_id=int(sys.argv[2]))
batches = {}
for k in range(200 * len(TACTILE_READ_BATCHES)):
    address, regions = TACTILE_READ_BATCHES[k % len(TACTILE_READ_BATCHES)]
    values = hand.read_holding(address, sum(count for _, count in regions))
    batches.setdefault(str(address), []).append(values)
moved = hand.send_raw([0, 200, 400, 600, 800, 1000])
time.sleep(1.0)
angles = hand.read_holding(ANGLE_ACT, 6)
hand.close()
print(json.dumps({"batches": batches, "moved": moved, "angles": angles}))
