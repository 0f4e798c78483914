"""ability-hand: 200 touch readings through the SDK's own threads, then a closed hand. Run it in a writable folder."""

import json
import sys
import time

from ah_wrapper import AHSerialClient, Observer


class Log(Observer):
    def __init__(self):
        self.fsr, self.pos, self.vel, self.cur = [], [], [], []

    def update_fsr(self, fsr):
        self.fsr.append(list(fsr))

    def update_pos(self, position):
        self.pos.append(list(position))

    def update_vel(self, velocity):
        self.vel.append(list(velocity))

    def update_cur(self, current):
        self.cur.append(list(current))

    def update_hot_cold(self, hot_cold):
        assert hot_cold == 0


port, variant = sys.argv[1], int(sys.argv[2])
client = AHSerialClient(port=port, baud_rate=460800, reply_mode=variant, rate_hz=100, auto_start_threads=False)
client.hand._first_fsr = False  # report what the hand sends, not the change since the first frame
log = Log()
client.hand.add_observer(log)
client.start_threads()
client.set_position(60)
deadline = time.monotonic() + 20
while len(log.pos) < 250 and time.monotonic() < deadline:
    time.sleep(0.01)
client.close()
print(json.dumps({**vars(log), "reads": client.n_reads}))
