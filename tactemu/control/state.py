"""The statistics and the present state of an emulator, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.scene.steering import Steered
from tactemu.truth import Sample


def statistics_of(emulator: Emulator, channel: Channel) -> dict[str, Any]:
    """Return the statistics of one device, the counts of its frames and the driver's, and those of injected faults."""
    return defer_statistics(emulator, channel)()


def defer_statistics(emulator: Emulator, channel: Channel) -> Callable[[], dict[str, Any]]:
    """Return a function that returns :func:`statistics_of` as of now; another thread than the loop's may call it."""
    return channel.defer_statistics(emulator.truth.injected_at(channel.name))


def state_of(emulator: Emulator, steered: Mapping[str, Steered]) -> Callable[[], dict[str, Any]]:
    """Return a function that returns the present state: the time [s], bodies with their world poses, skins with their
    ports and latest samples. Call this in the loop; another thread may call the function."""
    around = emulator.truth.context
    poses = np.zeros((0, 7)) if around is None else around.poses()
    names = [] if around is None else around.names
    t_s = emulator.now_ns / 1e9
    taken = {name: motion.is_steered for name, motion in steered.items()}
    samples = {channel.name: emulator.truth.latest_of(channel.name) for channel in emulator.channels}
    return lambda: {
        "t_s": t_s,
        "bodies": {
            name: {
                "position": pose[:3],
                "quaternion": pose[3:],
                "movable": name in taken,
                "in_hand": taken.get(name, False),
            }
            for name, pose in zip(names, poses.tolist())
        },
        "skins": {
            channel.name: {
                "device": channel.device.name,
                "ports": {port: wire.transport.address for port, wire in channel.wires.items()},
                "sample": next(iter(samples[channel.name].values()), None),
                **({"senses": samples[channel.name]} if len(samples[channel.name]) > 1 else {}),
            }
            for channel in emulator.channels
        },
    }


def row_of(sample: Sample) -> dict[str, Any]:
    """Return a sample as the JSON object of a line; its arrays stay arrays."""
    return {
        "t_ns": sample.t_ns, "device": sample.device, "number": sample.number, "sense": sample.sense,
        "ideal": sample.ideal, "measured": sample.measured, "counts": sample.counts,
    }  # fmt: skip
