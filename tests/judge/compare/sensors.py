"""Sensors for the tests of `tactemu compare`: models with one planted difference, on a bench in real time.

``python -m tests.judge.compare.sensors NAME PORT [TAXELS]`` is a sensor behind a port until its input ends.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import firmware_protocols as fp
from firmware_protocols import CanFrame, Device, Sent
from firmware_protocols.sums import crc16_modbus, sum16, xor8
from tactemu import transports
from tactemu.base.clock import RealClock
from tactemu.judge.compare.bench import Bench, Readings
from tactemu.judge.compare.model import port_of

SPECIMEN = Readings(7, baseline_n=0.2, gain=1.2, noise_n=0.05)
"""A specimen with its own rest, gain and noise."""


def edited(name: str, edit: Callable, **options) -> Callable[..., Device]:
    """Return a maker of a device whose frames ``edit(frame)`` changes: one frame, or several, or none."""

    def make(**more) -> Device:
        base = fp.device_class(name)

        def changed(outs):
            found = []
            for out in outs:
                frame = out.frame if isinstance(out, Sent) else out
                new = edit(frame) if isinstance(frame, bytes | CanFrame) else [out]
                new = new if isinstance(new, list) else [new]
                found += [replace(out, frame=each) if isinstance(out, Sent) else each for each in new]
            return found

        methods = {
            "stream": lambda self, t_ns, name: changed(base.stream(self, t_ns, name)),
            "receive": lambda self, data, t_ns, port: changed(base.receive(self, data, t_ns, port)),
        }
        cls = type(base.__name__, (base,), {**methods, "__module__": base.__module__})
        return cls(**options, **more)

    return make


def resummed(frame: bytes) -> bytes:
    return frame[:-2] + sum16(frame[:-2]).to_bytes(2, "big")


def omd(change: Callable[[bytearray], object]) -> Callable:
    """Return an edit of the data frames of an OptoForce, with a right sum."""

    def edit(frame: bytes):
        if len(frame) != 16:
            return frame
        data = bytearray(frame)
        change(data)
        return resummed(bytes(data))

    return edit


def swap_values(data: bytearray) -> None:
    for at in (8, 10, 12):
        data[at], data[at + 1] = data[at + 1], data[at]


def late(frame: bytes):
    return Sent(frame, delay_ns=20_000_000) if frame[3] == 0x30 else frame


class Extra:
    """An edit that adds a frame to every tenth."""

    def __init__(self, frame):
        self.frame, self.count = frame, 0

    def __call__(self, frame):
        self.count += 1
        return [frame, self.frame] if not self.count % 10 else frame


def slowed(name: str, factor: float) -> Callable[..., Device]:
    def make(**options) -> Device:
        device = fp.create(name, **options)
        for stream, period in device.periods.items():
            device.periods[stream] = round(period * factor)
        return device

    return make


def swapped_taxels(frame: bytes) -> bytes:
    """Exchange the chips 1 and 3 of an eFlesh board: three floats each, from byte 3 on."""
    data = bytearray(frame)
    data[15:27], data[39:51] = data[39:51], data[15:27]
    return bytes(data[:-1]) + bytes([xor8(bytes(data[2:-1]))])


def other_register(frame: bytes) -> bytes:
    """Have the register of the side read 3."""
    if frame != bytes.fromhex("7E 03 02 00 02 2C 4F"):
        return frame
    return (body := bytes.fromhex("7E 03 02 00 03")) + crc16_modbus(body).to_bytes(2, "little")


def moved(frame: CanFrame) -> CanFrame:
    return replace(frame, arbitration_id=frame.arbitration_id + 0x10)


@dataclass(frozen=True)
class Plant:
    """A planted difference: the device, the changed sensor, and the finding that names it."""

    device: str
    make: Callable[..., Device]
    kind: str
    words: str
    presses: bool = False


PLANTS: dict[str, Plant] = {
    "byte order": Plant("optoforce", edited("optoforce", omd(swap_values)), "byte order", "low byte first"),
    "register": Plant(
        "brainco_revo2", edited("brainco_revo2", other_register), "constant", "`side`: byte 4 is 03 instead of 02"
    ),
    "rate": Plant("optoforce", slowed("optoforce", 1.03), "rate", "a second instead of 100 (-2.9 %)"),
    "late answer": Plant("weiss_wts", edited("weiss_wts", late), "latency", "`matrix`: after"),
    "taxels": Plant("eflesh_binary", edited("eflesh_binary", swapped_taxels), "taxel order", "1 and 3", presses=True),
    "checksum": Plant(
        "eflesh_binary",
        edited("eflesh_binary", lambda f: f[:-1] + bytes([f[-1] ^ 0x5A])),
        "sum",
        ", XOR 5A holds in 100%",
    ),
    "silent": Plant("weiss_wts", edited("weiss_wts", lambda f: [] if f[3] == 0x37 else f), "silent", "`gain`: none"),
    "constant": Plant(
        "optoforce",
        edited("optoforce", omd(lambda d: d.__setitem__(1, 0x17))),
        "constant",
        "byte 1 (head) is 17 instead of 07",
    ),
    "counter": Plant(
        "optoforce", edited("optoforce", omd(lambda d: d.__setitem__(4, 0))), "counter", "again after 8 bits"
    ),
    "identifier": Plant("cyskin_cpm_finger", edited("cyskin_cpm_finger", moved), "identifier", "offset by +0x10"),
    "length": Plant("flexitac", edited("flexitac", lambda f: f + b"\0"), "length", "387 bytes instead of 386"),
    "extra": Plant("optoforce", edited("optoforce", Extra(bytes.fromhex("5501020304"))), "extra", "5 bytes, 1"),
    "extra on CAN": Plant(
        "cyskin_cpm_finger",
        edited("cyskin_cpm_finger", Extra(CanFrame(arbitration_id=0x7A0, data=b"\1\2"))),
        "extra",
        "7A0",
    ),
    "exception": Plant(
        "brainco_revo2",
        edited("brainco_revo2", lambda f: bytes.fromhex("7E8302F129") if f[:3] == b"\x7e\3\x0a" else f),
        "answer",
        "`which are on`: refused",
    ),
    "faster": Plant("anyskin", slowed("anyskin", 0.96), "rate", "104.2 a second instead of 100"),
}


def serve(name: str, address: str, presses: str = "") -> None:
    """Run a sensor behind a port until the input ends; a planted one, or a registered device."""
    make = PLANTS[name].make if name in PLANTS else lambda: fp.create(name)
    device = make()
    transport = transports.create(address)
    connector = port_of(device, "", address)
    pressed = {int(k): (float(a), float(b)) for k, a, b in (each.split(":") for each in presses.split(",") if each)}
    readings = replace(SPECIMEN, pressed=pressed)
    with Bench(device, connector, readings, transport=transport, clock=RealClock(), skew_ppm=120.0) as bench:
        print(transport.address, flush=True)
        threading.Thread(target=lambda: (sys.stdin.read(), bench.emulator.stop()), daemon=True).start()
        bench.emulator.run()


__all__ = ["PLANTS", "SPECIMEN", "edited", "port_of", "serve"]

if __name__ == "__main__":
    serve(*sys.argv[1:])
