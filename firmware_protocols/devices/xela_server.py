"""XELA's server: uSkin sensors as JSON over a WebSocket, as its gateway from the CAN bus serves them.

Wire: WebSocket, port 5000, any path, no subprotocol. The client sends nothing; its input is ignored. Text
messages, each a JSON object: first a greeting, then one for each sample of all the sensors.

    {"message": "Welcome"}

    {"message": 1476, "type": "routine", "time": 1695690788.83, "sensors": 2,
     "1": {"sensor": "1", "model": "uSPa44", "taxels": 16, "time": 1695690788.83,
           "data": "B8BF,37B0,881E,...", "calibrated": [0.7007, 4.3194, 4.4254, ...]},
     "2": {...}}

    key          about
    message      counts the samples
    time         clock of the server [s], Unix time; it starts where the option ``epoch`` says
    sensors      number of sensors; each has a key, its position from 1: a reader takes every integer key for one
    data         X,Y,Z of each taxel, row by row, raw counts as four hexadecimal digits
    calibrated   the same in N, if the server is set to calibrate (option ``calibrated``); a push is positive

Raw counts are those on the CAN bus (``xela_uskin``). Readers differ in the keys that they use: XELA's ROS 2 node takes
``data`` and any model, ``example.py`` of xela_setup only ``calibrated``, and only of uSPa46.

Without an address, or with 127.0.0.1, XELA's node connects to the machine's address in its network: start it with ``-i
localhost``, or the emulator ``--port ws:0.0.0.0:5000``.

Try it: ``tactemu run xela_server``, then ``websocket.create_connection("ws://127.0.0.1:5000").recv()``.
"""

import json
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Device, FieldGains, Option, Rollover, Transmissions, WebSocket, fact_table, grid_layout, place, stack,
)  # fmt: skip
from firmware_protocols.devices.xela_uskin import GAIN_UT_PER_N, PITCH_M, raw_columns

Model = Literal["uSPa44", "uSPa46", "uSPa22", "uSPa21", "uSPa11", "XR1944", "XR1844"]
SIZES_BY_MODEL: dict[str, tuple[int, int]] = {
    "uSPa44": (4, 4), "uSPa46": (4, 6), "uSPa22": (2, 2), "uSPa21": (2, 1), "uSPa11": (1, 1), "XR1944": (4, 4),
    "XR1844": (4, 4),
}  # fmt: skip
"""The rows and columns of taxels of each model."""


class XelaServer(Device):
    """A server with its sensors, in one message for each sample."""

    name = "xela_server"
    title = "XELA server, uSkin sensors over a WebSocket"
    kind = "fingertip"
    ports = (WebSocket(port=5000),)
    rollovers = (Rollover(name="message", bits=63, state="message"),)
    evidence = ("driver",)
    sources = (
        "mcsix/xela_server_ros2@3a890cf scripts/xela_service and its readme (keys, hexadecimal counts, an example)",
        "mcsix/xela_server_ros@a115511; penn-figueroa-lab/xela_setup@34d1dc1 example.py (4 rows of 6, calibrated)",
    )
    judge = "mcsix/xela_server_ros2@3a890cf, penn-figueroa-lab/xela_setup@34d1dc1, websocket-client 1.9.2"
    facts = fact_table("""
        stated touch: X, Y, Z of each taxel, from the top left, line by line, as whole numbers 0..65535 @
            mcsix/xela_server_ros2@3a890cf readme.md (Components), msg/Taxel.msg
        stated touch: forces X and Y have a sign for the direction; Z, a normal pressure, has none: a push is positive
            (one figure of an example is negative) @ xela_server_ros2 readme.md; xela_setup README.md
        assumed touch: raw counts and gains are those of xela_uskin; taxels are 4.7 mm apart, sensors 10 mm; forces are
            in N in the taxel's own frame, with four decimals @ xela_server_ros2, xela_server_ros, xela_setup, all files
        stated identity: model, position and number of taxels of each sensor, and nothing else @
            xela_server_ros2@3a890cf scripts/xela_service:456-486
        assumed identity: the rows and columns of all models except uSPa44 and uSPa46; curved models, extra dots and
            temperatures are not modelled @ xela_server_ros2, xela_server_ros, xela_setup, all files
        stated configuration: forces are sent only of sensors that have them, and only if xServ.ini enables them @
            xela_server_ros2@3a890cf readme.md (xServStream)
        assumed configuration: the greeting has no other key; messages from a client have no effect @
            scripts/xela_service:520-545, which looks at its key message alone, and sends nothing
        stated timing: the time is the Unix time of the server @ xela_server_ros2@3a890cf readme.md (1695690788.83)
        assumed timing: 100 messages a second, numbered from 1, even without a client @ xela_server_ros2,
            xela_server_ros, xela_setup, all files (messages 1476 and 5548 are shown)
    """)

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one sensor, or several by position")] = "uSPa46",
        calibrated: Annotated[bool, Option("send forces too, as set in xServ.ini")] = False,
        gains: FieldGains = GAIN_UT_PER_N,
        epoch: Annotated[float, Option("Unix time at power-up", unit="s", low=0.0)] = 1_700_000_000.0,
    ):
        self.models = (models,) if isinstance(models, str) else models or ("uSPa46",)
        self.calibrated, self.epoch = calibrated, epoch
        pads, x = [], 0.0
        for k, (rows, cols) in enumerate((SIZES_BY_MODEL[model] for model in self.models), 1):
            pads.append(place(grid_layout(rows, cols, PITCH_M, name=str(k)), (x + cols * PITCH_M / 2, 0.0, 0.0)))
            x += cols * PITCH_M + 0.01
        self.layout = stack(*pads)
        self.columns = raw_columns(gains)
        self.message = 0

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the message of one sample."""
        self.message += 1
        time = round(self.epoch + t_ns * 1e-9, 6)
        counts, newtons = map(self.layout.on_wire, (self.counts, self.present + 0.0))  # zeros are 0.0, not -0.0
        sample = {"message": self.message, "type": "routine", "time": time, "sensors": len(self.models)}
        for position, (model, patch) in enumerate(zip(self.models, self.layout.patches), 1):
            sensor = {"sensor": str(position), "model": model, "taxels": len(patch), "time": time}
            sensor["data"] = ",".join(f"{count:04X}" for count in counts[patch.taxels].ravel().tolist())
            if self.calibrated:
                sensor["calibrated"] = np.round(newtons[patch.taxels].ravel(), 4).tolist()
            sample[str(position)] = sensor
        return [json.dumps(sample).encode("ascii")]

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Return the greeting to a client that has connected."""
        return [b'{"message": "Welcome"}'] if dtr else ()
