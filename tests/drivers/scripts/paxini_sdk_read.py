"""paxini-sdk: the distributed force of an S1813 elite 200 times in about a second, its resultant, a calibration."""

import json
import logging
import sys
import time

from paxini_sdk import SingleSensorBoard

logging.disable(logging.WARNING)
with SingleSensorBoard(sys.argv[1], device_id=3, sensor="PXSR-STDDP03F") as board:
    many = []
    for _ in range(200):
        many.append([point.as_tuple() for point in board.read_distributed_force()])
        time.sleep(0.005)
    resultant = board.read_resultant_force()
    board.calibrate()
print(json.dumps({"many": many, "resultant": resultant}))
