"""nibotics-hand: moves the index finger and takes 200 updates of what fifteen places feel."""

import json
import sys
import time

from nibotics import NI_PRVS01

many, places = [], ("pinky", "ring", "middle", "index", "thumb_radial_extension")


def take(data):
    many.append([[data.pressure[place], data.temperature[place]] for place in places])


with NI_PRVS01(sys.argv[1]) as hand:
    while not all(map(hand.read_sensors().pressure.get, places)):  # a slow line brings a hand in pieces
        time.sleep(0.01)
    hand.on_sensor_update = take
    hand.move("index", 1234, 77)
    end = time.monotonic() + 40
    while len(many) < 450 and time.monotonic() < end:
        time.sleep(0.01)
    data = hand.read_sensors()
    got = {"positions": hand.get_positions(), "accel": data.imu.accel, "gyro": data.imu.gyro, "mics": data.microphone}
got["many"] = [[value for place in row for value in place[0]] for row in many[::2]]
got["warm"] = many[-1][3][1]
print(json.dumps(got))
