"""Ways to feed a device, and checks that every device with commands must pass."""

import random

import numpy as np

from firmware_protocols import Delayed, Device, Reading


def frames(outgoing) -> list:
    """Frames without their delays."""
    return [item.frame if isinstance(item, Delayed) else item for item in outgoing]


def push(device: Device, newtons) -> Reading:
    """A reading in which every taxel is pushed along its normal: one number, or one per taxel [N]."""
    newtons = np.broadcast_to(newtons, len(device.layout))
    return Reading(t_ns=0, values=-newtons[:, None] * device.layout.normals)


def whole(device: Device, data: bytes, t_ns: int) -> list:
    return frames(device.receive(data, t_ns))


def byte_by_byte(device: Device, data: bytes, t_ns: int) -> list:
    return [frame for byte in data for frame in frames(device.receive(bytes([byte]), t_ns))]


def check_commands(make, *, gap_ns: int = 10_000_000, trailing: bytes = b"") -> None:
    """Each documented command answered as documented: whole, byte by byte, and with trailing bytes."""
    for feed, tail in ((whole, b""), (byte_by_byte, b""), (whole, trailing)):
        for command in make().commands:
            device = make()
            device.power_on(0)
            device.sample(push(device, 0.5), 0)
            t_ns = gap_ns
            for request in command.after:
                feed(device, request, t_ns)
                t_ns += gap_ns
            got = feed(device, command.request + tail, t_ns)
            check_reply(command, got)


def check_reply(command, got) -> None:
    if command.reply is None:
        assert got == [], f"{command.name}: expected silence, got {got}"
    elif callable(command.reply):
        assert command.reply(got), f"{command.name}: {got}"
    else:
        assert got == list(command.reply), command.name


def mutate(data: bytes, rng: random.Random) -> bytes:
    """One to four random changes: bytes flipped, dropped, inserted, swapped for noise."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out) + 1)
        kind = rng.randrange(4)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(out):
            del out[at]
        elif kind == 2:
            out.insert(at, rng.randrange(256))
        else:
            out[at : at + 1] = rng.randbytes(rng.randint(0, 6))
    return bytes(out)


def survive(device: Device, count: int = 3000, seed: int = 1, gap_ns: int = 10_000_000) -> None:
    """Mutated commands in random chunks never raise; replies stay frames; the first command works afterwards."""
    rng = random.Random(seed)
    requests = [command.request for command in device.commands]
    t_ns = 0
    for k in range(count):
        t_ns += gap_ns
        data = mutate(rng.choice(requests), rng)
        cut = rng.randrange(len(data) + 1)
        for piece in (data[:cut], data[cut:]):
            assert all(isinstance(frame, bytes) and frame for frame in frames(device.receive(piece, t_ns)))
        if k % 50 == 0:
            device.sample(push(device, rng.uniform(-1, 30)), t_ns)
    settle(device, t_ns)


def settle(device: Device, t_ns: int) -> None:
    """After the noise every command is answered again, once the half-eaten one is over."""
    for command in device.commands:
        for _ in range(400):
            t_ns += 1_000_000_000
            for request in (*command.after, command.request):
                t_ns += 10_000_000
                got = frames(device.receive(request, t_ns))
            if command.reply is None or got:
                break
        check_reply(command, got)
