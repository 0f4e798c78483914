"""XELA's server: uSkin sensors as JSON over a WebSocket, as its gateway to the CAN bus serves them.

Wire: WebSocket, port 5000, any path, no subprotocol. The client sends nothing; what it does send is ignored. Text
messages, each a JSON object: first a greeting, then one for each sample of all the sensors.

    {"message": "Welcome"}

    {"message": 1476, "type": "routine", "time": 1695690788.83, "sensors": 2,
     "1": {"sensor": "1", "model": "uSPa44", "taxels": 16, "time": 1695690788.83,
           "data": "B8BF,37B0,881E,...", "calibrated": [0.7007, 4.3194, -4.4254, ...]},
     "2": {...}}

    key          about
    message      counts the samples
    time         clock of the server [s]
    sensors      how many there are; each has a key, its position from 1: a reader takes every whole number for one
    data         X,Y,Z of each taxel, row by row, raw counts as four hexadecimal digits
    calibrated   the same in N, if the server is told to calibrate (option ``calibrated``)

Raw counts are those that the CAN bus carries (``xela_uskin``). Readers differ in what they look at: XELA's ROS 2 node
takes ``data`` and any model, ``example.py`` of xela_setup only ``calibrated``, and only of one uSPa46.

Try it: ``tactemu run xela_server``, then ``websocket.create_connection("ws://127.0.0.1:5000").recv()``.
"""

from __future__ import annotations

import json
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Column, Counts, Device, Option, Outs, Reading, Rollover, WebSocket, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.devices.xela_uskin import COUNT_UT, GAIN_UT_PER_N, PITCH, REST_FIELD_UT
from firmware_protocols.layouts import place, stack
from firmware_protocols.magnetic import LinearMagnet

Model = Literal["uSPa44", "uSPa46", "uSPa22", "uSPa21", "uSPa11", "XR1944", "XR1844"]
SIZES: dict[str, tuple[int, int]] = {
    "uSPa44": (4, 4), "uSPa46": (4, 6), "uSPa22": (2, 2), "uSPa21": (2, 1), "uSPa11": (1, 1), "XR1944": (4, 4),
    "XR1844": (4, 4),
}  # fmt: skip
"""Rows and columns of taxels."""


class XelaServer(Device):
    """The server with its sensors."""

    name = "xela_server"
    title = "XELA server, uSkin sensors over a WebSocket"
    kind = "fingertip"
    ports = (WebSocket(port=5000),)
    rollovers = (Rollover(name="message", bits=63, state="message"),)
    evidence = ("driver",)
    sources = (
        "mcsix/xela_server_ros2@3a890cf scripts/xela_service and its readme (keys, hexadecimal counts, an example)",
        "mcsix/xela_server_ros@a115511; penn-figueroa-lab/xela_setup@abd787d example.py (4 rows of 6, calibrated)",
    )
    judge = "websocket-client 1.9.2, which knows messages; nobody who knows XELA's"
    assumed = (
        "raw counts as of xela_uskin, 4.7 mm apart; sensors side by side, 10 mm between them; the order, but of uSPa46",
        "calibrated: N in the taxel's own frame, z out of the skin, four decimals",
        "100 Hz; messages are counted from 1, also while nobody listens; the server's clock starts at 0",
        "the greeting has no other key; curved and older models of other shapes are left out, as are extradots and "
        "temperatures",
    )

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one sensor, or several by position")] = "uSPa46",
        calibrated: Annotated[bool, Option("as in xServ.ini")] = False,
        gains: Annotated[
            tuple[float, float, float],
            Option("of the force along x, y and z of a taxel, z out of the skin", unit="uT/N"),
        ] = GAIN_UT_PER_N,
    ):
        self.models = (models,) if isinstance(models, str) else models or ("uSPa46",)
        self.calibrated = calibrated
        pads, x = [], 0.0
        for k, (rows, cols) in enumerate((SIZES[model] for model in self.models), 1):
            pads.append(place(grid_layout(rows, cols, PITCH, name=str(k)), (x + cols * PITCH / 2, 0.0, 0.0)))
            x += cols * PITCH + 0.01
        self.layout = stack(*pads)
        rest = [round(field / COUNT_UT) for field in REST_FIELD_UT]
        push = -1 if gains[2] > 0 else 1
        self.columns = tuple(
            Column(name=axis.upper(), axis=axis, low=0, high=0xFFFF, rest=at, push=push if axis == "z" else 0)
            for axis, at in zip(("x", "y", "z"), rest)
        )
        self.magnet = LinearMagnet(gain=gains, offset=REST_FIELD_UT)
        self.message = 0

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Raw counts X, Y, Z of each taxel, 0..65535, shape ``(n, 3)``."""
        self.newtons = self.layout.to_taxel_frame(reading["force"])
        self.counts = quantize(self.magnet(self.newtons) / COUNT_UT)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """A message."""
        self.message += 1
        time = round(t_ns * 1e-9, 6)
        counts, newtons = self.layout.on_wire(self.counts), self.layout.on_wire(self.newtons)
        said = {"message": self.message, "type": "routine", "time": time, "sensors": len(self.models)}
        for position, (model, patch) in enumerate(zip(self.models, self.layout.patches), 1):
            sensor = {"sensor": str(position), "model": model, "taxels": len(patch), "time": time}
            sensor["data"] = ",".join(f"{count:04X}" for count in counts[patch.taxels].ravel().tolist())
            if self.calibrated:
                sensor["calibrated"] = np.round(newtons[patch.taxels].ravel(), 4).tolist()
            said[str(position)] = sensor
        return [json.dumps(said).encode("ascii")]

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Outs:
        """A client has come."""
        return [b'{"message": "Welcome"}'] if dtr else ()
