"""paxini-sdk: the distributed force of an S1813 elite 200 times, its resultant, a calibration."""

import json
import logging
import sys

from paxini_sdk import SingleSensorBoard

logging.disable(logging.WARNING)
with SingleSensorBoard(sys.argv[1], sensor="PXSR-STDDP03F") as board:
    many = [[point.as_tuple() for point in board.read_distributed_force()] for _ in range(200)]
    resultant = board.read_resultant_force()
    board.calibrate()
print(json.dumps({"many": many, "resultant": resultant}))
