"""orca-core: finds the board, reads 200 pushes of five fingertips, zeroes them, reboots the board."""

import json
import sys
import time

from orca_core.hardware.hand_serial_link import HandSerialLink
from orca_core.hardware.sensing.serial_discovery import probe_orca_info
from orca_core.hardware.tactile_client import TactileClient

info = probe_orca_info(sys.argv[1], timeout=5.0)
assert info is not None
link = HandSerialLink(port=sys.argv[1], baudrate=921600)
link.connect()
client = TactileClient(link)
client.connect()
got = {"info": [info.role, info.side, info.serial], "version": str(client.board_version), "many": [], "resultants": []}
got["taxels"] = client.read_num_taxels()
client.start_stream(resultant=True, taxels=True)
client.wait_for_first_frame()
seen, end = set(), time.monotonic() + 40
while len(got["many"]) < 200 and time.monotonic() < end:
    reading = client.get_latest()
    if reading is None or reading.seq in seen:
        time.sleep(0.002)
        continue
    seen.add(reading.seq)
    got["many"].append([[round(10 * v) for v in t] for finger in reading.taxels.taxels.values() for t in finger])
    got["resultants"].append([[round(10 * v) for v in force] for force in reading.forces.forces.values()])
stats = client.get_stats()
got["bad"] = stats.frames_bad_payload + stats.frames_bad_payload_size
got["zero"] = client.zero_sensors()
client.reboot_board()
client.disconnect()
link.disconnect()
print(json.dumps(got))
