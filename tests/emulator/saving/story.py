"""A run in which much goes on, told whole and told on from a state that was saved in the middle.

``python -m tests.emulator.saving.story FOLDER`` tells on from every state in a folder, and prints digests.
"""

import hashlib
import json
import sys
from pathlib import Path

from firmware_protocols import registry
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.truth import Truth

SECONDS = 0.3
HALF_S = 0.0015
"""Between the two halves of a request."""
SAVES_S = (0.0813, 0.162)
"""Amid requests, samples and faults; and after a restart, where a device takes its time to boot."""
CLOCK = {"delay_s": 0.002, "jitter_s": 0.003, "skew_ppm": 400.0, "drift_ppm_per_s": 5.0}
FAULTS = ["late 20% by 7ms", "drop 5%", "flip 10%", "reorder 10%", "stray 5%"]
GOING_WRONG = [
    {"at": 0.05, "until": 0.2, "dead": [0]},
    {"at": 0.07, "until": 0.09, "hang": True},
    {"at": 0.16, "reset": True},
    {"at": 0.05, "until": 0.2, "set": {"noise": 0.01}},
]


def of_device(name: str) -> dict:
    """The default scene of a device with imperfections of values, time and wire, and a schedule."""
    data = file.default_scene(name).tables.model_dump(by_alias=True, exclude_none=True)
    (skin,) = data["skin"]
    data["scene"] |= {"dt": 0.005}
    taxels = len(registry.create(name).layout) > 0
    spoilt = {"noise": 1e-3, "random_walk": 1e-4, "delay": 0.02} if taxels else {}
    skin |= {"options": skin["options"] | spoilt, "clock": CLOCK, "faults": FAULTS}
    data["scenario"] = GOING_WRONG if taxels else [event for event in GOING_WRONG if not {"dead", "set"} & event.keys()]
    return data


def build(data: dict) -> Emulator:
    """An emulator of the scene, not yet open."""
    return assemble(
        file.check(data), AssemblyOptions(port="memory:", seed=3), clock=VirtualClock(), truth=Truth(keep="256MB")
    ).emulator


def ask(emulator: Emulator, after_s: float = 0.0) -> None:
    """Let the driver send every documented request in its stages, else in two halves, those after a time."""
    (channel,) = emulator.channels
    here = {"", *(name for name, wire in channel.wires.items() if hasattr(wire.transport, "driver"))}
    commands = [command for command in channel.device.commands if command.port in here]
    for k, command in enumerate(commands):
        wire = channel.wires.get(command.port) or channel.wire
        request, t_s = command.frame, 0.02 + k * (SECONDS - 0.06) / len(commands)
        halves = command.stages
        if len(halves) == 1 and isinstance(request, bytes):
            halves = [request[: len(request) // 2], request[len(request) // 2 :]]
        for half, at_s in zip(halves, (t_s, t_s + HALF_S)):
            if half and at_s > after_s:
                emulator.at(round(at_s * 1e9), lambda write=wire.transport.driver.write, half=half: write(half))  # type: ignore[attr-defined]


def heard(emulator: Emulator) -> list:
    """What left and what was felt, with times, and what was counted."""
    truth = emulator.truth
    frames = [(t_ns, device, repr(frame)) for t_ns, device, frame in truth.frames]
    samples = [
        (s.t_ns, s.number, s.sense, s.ideal.tobytes(), s.measured.tobytes(), s.counts.tobytes()) for s in truth.samples
    ]
    return [frames, samples]


def counted(emulator: Emulator) -> list:
    """All counters at the end."""
    statistics = [channel.statistics.as_dict() for channel in emulator.channels]
    wires = [sorted(wire.counters.items()) for wire in emulator.wires]
    devices = [sorted(channel.device.counters.items()) for channel in emulator.channels]
    truth = emulator.truth
    return [statistics, wires, devices, sorted(truth.counts.items()), sorted(truth.injected.items())]


def told_on(emulator: Emulator, from_s: float) -> list:
    """The end of the story."""
    ask(emulator, from_s)
    with emulator:
        emulator.run(SECONDS - from_s)
    return [*heard(emulator), counted(emulator)]


def digest(told: list) -> str:
    """The story in short."""
    return hashlib.sha256(repr(told).encode()).hexdigest()


if __name__ == "__main__":
    digests = {}
    for path in sorted(Path(sys.argv[1]).glob("*.npz")):
        emulator = build(of_device(path.stem))
        emulator.restore(path)
        digests[path.stem] = digest(told_on(emulator, SAVES_S[0]))
    print(json.dumps(digests))
