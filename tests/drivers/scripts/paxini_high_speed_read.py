"""paxini-sdk: what is fitted, 200 pushes of two modules, a calibration."""

import json
import logging
import sys

from paxini_sdk import HighSpeedHandBoard

logging.disable(logging.WARNING)
with HighSpeedHandBoard(sys.argv[1]) as board:
    got = {"version": board.read_version(), "modules": board.read_active_modules(), "many": [], "resultants": []}
    for frame in board.stream_auto_push(max_frames=200):
        got["many"].append([point for points in frame.distributed_forces.values() for point in points])
        got["resultants"].append(list(frame.resultant_forces.values()))
    got["names"] = list(frame.distributed_forces)
    board.calibrate()
    got["read"] = board.read_resultant_forces()
print(json.dumps(got))
