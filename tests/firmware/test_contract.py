"""What every registered device owes: one test over the registry. A new device is tested by its registration alone."""

import hashlib
import itertools
import random
import sys
import typing
import warnings

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.device import Delayed, Evidence, Quantity
from tactemu.scene.file import default_scene
from tests.firmware.golden import golden_vectors_of, replay
from tests.fuzz import TIMES

FUZZED_COMMANDS = 10_000 * TIMES
SECOND = 1_000_000_000
FD_LENGTHS = {*range(9), 12, 16, 20, 24, 32, 48, 64}
CASES = [(name, wire.kind) for name in fp.names() for wire in fp.load(name).wires]


def started(name: str, kind: str) -> fp.Device:
    device = fp.create(name)
    device.plug(kind)
    device.power_on(0)
    device.opened(0)
    device.sample(reading_of(device, 0), 0)
    return device


def reading_of(device: fp.Device, k: int) -> fp.Reading:
    """A reading of the size that skins feel (tenths of N and mm, tens of kPa), another for each ``k``."""
    rng = np.random.default_rng(k)
    n = len(device.layout)
    t_ns = k * device.period_ns
    match device.senses:
        case "force":
            values = -rng.random((n, 1)) * device.layout.normals + 0.2 * rng.standard_normal((n, 3))
        case "displacement":
            values = -1e-3 * rng.random((n, 1)) * device.layout.normals
        case "pressure":
            values = 5e4 * rng.random(n)
        case "depth":
            values = 1e-3 * rng.random(n)
        case "touch":
            values = rng.random(n) < 0.5
    return fp.Reading(t_ns=t_ns, values=values, temperature=20.0 + 10.0 * rng.random(n))


def frames_of(outgoing) -> list:
    return [out.frame if isinstance(out, Delayed) else out for out in outgoing]


def check_frames(device: fp.Device, outgoing) -> list:
    """The frames, each of them possible on the device's wire."""
    for out in outgoing:
        if isinstance(out, Delayed):
            assert isinstance(out.delay_ns, int) and out.delay_ns >= 0
    frames = frames_of(outgoing)
    for frame in frames:
        if device.wire.kind == "can":
            assert isinstance(frame, fp.CanFrame)
            assert 0 <= frame.arbitration_id < (1 << 29 if frame.is_extended_id else 1 << 11)
            assert len(frame.data) in (FD_LENGTHS if frame.is_fd else range(9))
            assert not frame.is_fd or device.wire.data_bitrate
        else:
            assert isinstance(frame, bytes) and frame
    return frames


def send(device: fp.Device, request, t_ns: int) -> list:
    return check_frames(device, device.receive(request, t_ns))


def agrees(command: fp.Command, frames: list) -> bool:
    if command.reply is None:
        return frames == []
    if callable(command.reply):
        return bool(command.reply(frames))
    if frames and isinstance(frames[0], bytes):
        return b"".join(frames) == b"".join(command.reply)
    return frames == list(command.reply)


# -- datasheet --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", fp.names())
def test_datasheet_is_complete(name):
    cls = fp.load(name)
    assert cls.name == name
    assert cls.title and cls.wires and cls.rate_hz > 0
    assert cls.senses in typing.get_args(Quantity)
    assert cls.evidence and set(cls.evidence) <= set(typing.get_args(Evidence))
    assert cls.sources and all(source.strip() for source in cls.sources)
    assert cls.judge.strip()
    assert isinstance(cls.assumed, tuple) and isinstance(cls.sources, tuple)
    docs = (sys.modules[cls.__module__].__doc__ or "").lower()
    for part in ("wire", "try it"):
        assert part in docs, f"the docstring of {cls.__module__} lacks {part!r}"


@pytest.mark.parametrize("name", fp.names())
def test_its_name_alone_makes_a_scene(name):
    scene = default_scene(name).tables
    assert [skin.device for skin in scene.skin] == [name]
    assert len(scene.body) >= 2, "a link and something that touches it"


@pytest.mark.parametrize("name", fp.names())
def test_layout_fits_together(name):
    layout = fp.create(name).layout
    n = len(layout)
    assert n and layout.positions.shape == layout.normals.shape == layout.x_axes.shape == (n, 3)
    assert np.isfinite(layout.positions).all() and layout.pitch > 0 and layout.area > 0
    assert np.allclose((layout.normals * layout.x_axes).sum(1), 0, atol=1e-6)
    assert np.allclose(np.linalg.norm(layout.x_axes, axis=1), 1, atol=1e-6)
    covered = np.concatenate([np.arange(n)[patch.taxels] for patch in layout.patches])
    assert sorted(covered) == list(range(n)), "the patches cover every taxel once"
    distances = np.linalg.norm(layout.positions[:, None] - layout.positions[None], axis=-1) + np.eye(n)
    assert distances.min() > 0.2 * layout.pitch, "two taxels at one place"


# -- readings ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_digitizes_what_is_felt(name, kind):
    device = started(name, kind)
    rest = _extreme(device, 0.0)
    for push in (1.0, 1e9, -1e9):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            counts = device.digitize(_extreme(device, push))
        assert len(counts) == len(device.layout) and counts.ndim in (1, 2)
        assert np.isfinite(counts.astype(float)).all()
        assert push < 0 or not np.array_equal(counts, device.digitize(rest)), "a push changes nothing"


def _extreme(device: fp.Device, push: float) -> fp.Reading:
    """Every taxel pushed by ``push`` newtons, 10 kilopascals, tenths of a millimetre."""
    layout = device.layout
    values = {
        "force": -push * layout.normals,
        "displacement": -1e-4 * push * layout.normals,
        "pressure": np.full(len(layout), 1e4 * push),
        "depth": np.full(len(layout), 1e-4 * push),
        "touch": np.full(len(layout), push > 0),
    }[device.senses]
    return fp.Reading(t_ns=0, values=values)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_same_inputs_same_bytes(name, kind):
    assert _digest(name, kind) == _digest(name, kind)


def _digest(name: str, kind: str) -> str:
    """SHA-256 over two seconds of the stream and the answers to every command on the way."""
    device, digest = started(name, kind), hashlib.sha256()
    requests = itertools.cycle([r for c in device.commands for r in (*c.after, c.request)] or [None])
    count = min(200, max(20, round(2 * SECOND / device.period_ns)))
    for k in range(1, count):
        t_ns = k * SECOND // 100
        request = next(requests)
        answered = device.receive(request, t_ns) if request is not None else ()
        for frame in frames_of([*device.sample(reading_of(device, k), t_ns), *answered]):
            digest.update(str(frame).encode() if isinstance(frame, fp.CanFrame) else frame)
    return digest.hexdigest()


# -- commands ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_commands_are_answered_as_documented(name, kind):
    names = [command.name for command in started(name, kind).commands]
    assert len(set(names)) == len(names), "two commands of one name"
    for command in started(name, kind).commands:
        _check_command(started(name, kind), command, 0)


def _check_command(device: fp.Device, command: fp.Command, t_ns: int) -> None:
    unknown = device.counters["unknown_command"]
    for request in command.after:
        send(device, request, t_ns)
        t_ns += SECOND
    frames = send(device, command.request, t_ns)
    assert agrees(command, frames), f"{device.name}: {command.name}: {[str(f) for f in frames]}"
    assert device.counters["unknown_command"] == unknown, f"{device.name} does not know its command {command.name}"


@pytest.mark.parametrize(("name", "kind"), [case for case in CASES if case[1] != "can"])
def test_input_comes_in_any_pieces(name, kind):
    for command in started(name, kind).commands:
        for pieces in _cuts(command.request):
            device = started(name, kind)
            for request in command.after:
                send(device, request, 0)
            frames = [frame for piece in pieces for frame in send(device, piece, SECOND)]
            assert agrees(command, frames), f"{name}: {command.name} in {len(pieces)} pieces: {frames}"


def _cuts(request: bytes) -> list[list[bytes]]:
    """Whole, byte by byte, in two halves."""
    half = len(request) // 2
    return [[request], [request[i : i + 1] for i in range(len(request))], [request[:half], request[half:]]]


@pytest.mark.parametrize(("name", "kind"), [case for case in CASES if case[1] != "can"])
def test_the_next_request_may_follow_at_once(name, kind):
    """A request, the first half of the next in the same chunk, then its rest."""
    for command in started(name, kind).commands:
        device = started(name, kind)
        for request in command.after:
            send(device, request, 0)
        half = len(command.request) // 2
        first = send(device, command.request + command.request[:half], SECOND)
        assert agrees(command, first), f"{name}: {command.name} with trailing bytes: {first}"
        second = send(device, command.request[half:], SECOND + 1)
        assert bool(second) == bool(first), f"{name}: {command.name} after its own first half: {second}"


@pytest.mark.parametrize("name", fp.names())
def test_golden_frames(name):
    vectors = golden_vectors_of(name)
    assert vectors, f"{name} has no golden frames in tests/data/golden"
    for vector in vectors:
        replay(vector, name)


# -- anything else ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_survives_random_and_mutated_commands(name, kind):
    device = started(name, kind)
    rng = random.Random(f"{name}/{kind}")
    requests = [r for command in device.commands for r in (*command.after, command.request)]
    t_ns = 0
    for k in range(FUZZED_COMMANDS):
        t_ns += 1_000_000
        outgoing = device.receive(_mutated(rng, requests, kind), t_ns)
        if outgoing and not k % 16:
            check_frames(device, outgoing)
    assert sum(device.counters.values()) > 0, "what came was not counted"
    for k in range(3):
        check_frames(device, device.sample(reading_of(device, k), t_ns))
    _answers_again(device, t_ns)
    device.power_on(t_ns)
    device.opened(t_ns)
    device.sample(reading_of(device, 0), t_ns)
    for command in device.commands:
        t_ns += 10 * SECOND
        _check_command(device, command, t_ns)


def _answers_again(device: fp.Device, t_ns: int) -> None:
    """Without a power cycle: what awaits an answer gets one, at the latest when a half-received packet is over."""
    asked = [command for command in device.commands if command.reply]
    for command, _ in itertools.product(asked, range(100)):
        t_ns += SECOND
        if any(send(device, request, t_ns) for request in (*command.after, command.request)):
            return
    assert not asked, f"{device.name} no longer answers"


def _mutated(rng: random.Random, requests: list, kind: str):
    if kind != "can":
        data = rng.choice(requests) if requests and rng.random() < 0.7 else rng.randbytes(rng.randrange(40))
        return _damaged(rng, data)
    like = rng.choice(requests) if requests else fp.CanFrame(arbitration_id=0)
    extended = rng.random() < 0.05
    ident = rng.getrandbits(29 if extended else 11) if rng.random() < 0.2 else like.arbitration_id
    data = like.data if rng.random() < 0.6 else rng.randbytes(rng.randrange(9))
    remote = rng.random() < 0.05
    return fp.CanFrame(
        arbitration_id=ident,
        data=b"" if remote else _damaged(rng, data)[: 64 if like.is_fd else 8],
        is_extended_id=extended or like.is_extended_id,
        is_remote_frame=remote,
        is_fd=like.is_fd and not remote,
        bitrate_switch=like.bitrate_switch and not remote,
    )


def _damaged(rng: random.Random, data: bytes) -> bytes:
    """Whole (1 in 5), or with a byte changed, cut short, doubled, or with bytes put in."""
    at = rng.randrange(len(data) + 1)
    match rng.randrange(5):
        case 0:
            return data[:at] + rng.randbytes(1) + data[at + 1 :]
        case 1:
            return data[:at]
        case 2:
            return data + data[at:]
        case 3:
            return data[:at] + rng.randbytes(rng.randrange(1, 4)) + data[at:]
    return data
