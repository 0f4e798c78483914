"""plusml-rh56dftp over Modbus TCP: every matrix once, one matrix 200 times, a few registers."""

import json
import logging
import sys

from RH56DFTP.RH56DFTP_TCP import RH56DFTP_TCP

logging.disable(logging.INFO)
host, _, port = sys.argv[1].partition(":")
hand = RH56DFTP_TCP(host=host, port=int(port))
names = [name for name in hand.registers if name.startswith("TACTILE")]
once = {name: (hand.registers[name].address[0], hand.get(name)) for name in names}
many = [hand.get("TACTILE_INDEX_FINGER_TIP_12x8") for _ in range(200)]
written = hand.set("POS_SET(2)", 300) and hand.set("CLEAR_ERROR", 1)
others = {name: hand.get(name) for name in ("HAND_ID", "FORCE_ACT(0)", "TEMP(1)", "ERROR(5)", "POS_SET(2)")}
hand.close()
print(json.dumps({"once": once, "many": many, "written": written, "others": others}))
