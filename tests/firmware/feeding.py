"""Ways to feed a device, and checks that every device with commands must pass."""

import random

import numpy as np

from firmware_protocols import CanFrame, Convert, Device, Reading, Restart, Sense, Sent
from firmware_protocols.frames import frame_of

REST = {"temperature": 25.0, "acceleration": (0.0, 0.0, 9.80665)}
"""What senses see of a skin that nobody touches, where it is not 0; per point."""
WIDTHS = {"force": 3, "displacement": 3, "acceleration": 3, "angular_velocity": 3, "wrench": 6}
"""Numbers per point, where it is not one."""


def frames(outs) -> list:
    """The frames among what a method returned."""
    bare = [out.frame if isinstance(out, Sent) else out for out in outs]
    return [out for out in bare if not isinstance(out, Convert | Restart)]


def pushes_of(device: Device, pictures: dict[str, list]) -> np.ndarray:
    """Pushes per taxel [N] from pictures of patches by name; patches without a picture are not touched."""
    newtons = np.zeros(len(device.layout))
    for patch in device.layout.patches:
        if patch.name in pictures:
            shape = (patch.rows, patch.cols) if patch.rows else (patch.cols,)
            picture = np.array(pictures[patch.name], float)
            assert picture.shape == shape, f"patch {patch.name}: expected a picture of {shape}, got {picture.shape}"
            newtons[patch.taxels] = picture.ravel()
    assert set(pictures) <= {patch.name for patch in device.layout.patches}, f"patches: {sorted(pictures)}"
    return newtons


def reading_of(device: Device, pushes=0.0, stream: str = "", **values) -> Reading:
    """What the senses of a stream see, at rest but for ``pushes`` along the taxels' normals: one number, one per taxel
    [N], or pictures of patches by name. ``values`` are by sense and broadcast over its points."""
    newtons = pushes_of(device, pushes) if isinstance(pushes, dict) else np.broadcast_to(pushes, len(device.layout))
    forces = np.array(-newtons[:, None] * device.layout.normals)
    forces = np.broadcast_to(values.pop("force", forces), forces.shape)
    seen = {}
    for sense in device.senses_of(stream):
        value = values.pop(sense.key, None)
        seen[sense.key] = _felt(sense, device, forces) if value is None else _spread(sense, value)
    assert not values, f"{device.name} has no sense {sorted(values)}"
    return Reading(seen, stream)


def _felt(sense: Sense, device: Device, forces: np.ndarray) -> np.ndarray:
    at, layout = sense.at.positions, device.layout
    if sense.quantity == "wrench":
        torques = np.stack([np.cross(layout.positions - point, forces).sum(0) for point in at])
        return np.concatenate([np.broadcast_to(forces.sum(0), torques.shape), torques], axis=-1)
    touched = {
        "force": forces,
        "pressure": layout.push(forces) / layout.areas,
        "touch": layout.push(forces) > 0,
    }
    return touched.get(sense.quantity, _spread(sense, REST.get(sense.quantity, 0.0)))


def _spread(sense: Sense, value) -> np.ndarray:
    width, n = WIDTHS.get(sense.quantity), len(sense.at)
    value = np.asarray(value, float)
    shape = (n,) if width is None else (n, width)
    whole = np.array(np.broadcast_to(value, shape))
    return whole if sense.burst == 1 else np.repeat(whole[..., None], sense.burst, axis=-1)


def sample(device: Device, pushes=0.0, t_ns: int = 0, **values) -> list:
    """One conversion of every stream, as the runner does it: feel, then what leaves."""
    sent = []
    for stream in device.periods:
        device.feel(reading_of(device, pushes, stream, **values), t_ns)
        sent += frames(device.stream(t_ns, stream))
    return sent


def send(device: Device, data: bytes | CanFrame | str, t_ns: int = 0, port: str | None = None) -> list:
    """The frames that answer; text is hex or candump notation; a firmware that restarts itself does."""
    return _obeyed(device, device.receive(frame_of(data), t_ns, device.ports[0].name if port is None else port))


def _obeyed(device: Device, outs) -> list:
    if any(isinstance(out, Restart) for out in outs):
        device.power_cycle()
        for stream in device.periods:
            device.feel(reading_of(device, stream=stream), 0)
    return frames(outs)


def byte_by_byte(device: Device, data: bytes, t_ns: int = 0, port: str | None = None) -> list:
    return [frame for byte in data for frame in send(device, bytes([byte]), t_ns, port)]


def check_commands(make, *, gap_ns: int = 10_000_000, trailing: bytes = b"") -> None:
    """Each documented command answered as documented: whole and, of bytes, byte by byte and with trailing bytes."""
    device = make()
    sample(device, 0.5)
    fresh = device.snapshot()
    for command in device.commands:
        is_bytes = isinstance(command.frame, bytes)
        for feed, tail in ((send, b""), (byte_by_byte, b""), (send, trailing)) if is_bytes else ((send, None),):
            device.restore(fresh)
            port, t_ns = command.port or device.ports[0].name, gap_ns
            for request in command.after:
                feed(device, frame_of(request), t_ns, port)
                t_ns += gap_ns
            got = feed(device, command.frame + tail if tail else command.frame, t_ns, port)
            assert command.agrees(got), f"{command.name}: expected {command.reply}, got {got}"


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
    requests = [(command.frame, command.port or None) for command in device.commands]
    t_ns = 0
    for k in range(count):
        t_ns += gap_ns
        request, port = rng.choice(requests)
        data = mutate(request, rng)
        cut = rng.randrange(len(data) + 1)
        for piece in (data[:cut], data[cut:]):
            assert all(isinstance(frame, bytes) and frame for frame in send(device, piece, t_ns, port))
        if k % 50 == 0:
            sample(device, rng.uniform(-1, 30), t_ns)
    settle(device, t_ns)


def settle(device: Device, t_ns: int) -> None:
    """After the noise every command is answered again, once the half-eaten one is over."""
    for command in device.commands:
        for _ in range(400):
            t_ns += 1_000_000_000
            for request in (*command.after, command.request):
                t_ns += 10_000_000
                got = send(device, request, t_ns, command.port or None)
            if command.reply is None or got:
                break
        assert command.agrees(got), f"{command.name}: expected {command.reply}, got {got}"
