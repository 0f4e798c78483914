"""unienv-rohand: forces of the fingers 200 times, then all the other things that it reads and writes."""

import json
import sys
import time

import numpy as np
from unienv_rohand.rohand import RohandActor

hand = RohandActor(port=sys.argv[1])
many = [np.rint(hand.read_finger_forces() * 1000).astype(int).tolist() for _ in range(200)]
opened = np.rad2deg(hand.read_finger_angles()).tolist()
hand.send_position_commands_safe(np.ones(6))
moving = hand.read_finger_statuses().tolist()
time.sleep(1.2)
closed = np.rad2deg(hand.read_finger_angles()).tolist()
hand.send_angle_commands(np.deg2rad([20, 150, 140, 130, 120, 45]))
time.sleep(1.2)
hand.post_environment_step(0.0)
seen = {name: values.tolist() for name, values in hand.get_observation().items()}
hand.close()
print(json.dumps({"many": many, "opened": opened, "closed": closed, "moving": moving, "seen": seen}))
