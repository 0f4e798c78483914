"""Same seed, same bytes: the whole chain on a virtual clock, for every device, alone and among others."""

import functools
import hashlib
from pathlib import Path

import pytest

import firmware_protocols as fp
from firmware_protocols.frames import frame_of
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.truth import Truth

SECONDS = {"kata_hand": 6.5, "sensel_morph": 1.0, "anyskin": 10.0, "linker_hand_l6": 10.0, "xela_uskin": 10.0}
"""Of emulation, in the steps of 1 ms that a user gets; the others run until their scenes have pressed them."""
STEP_S = 0.005
"""Of physics for the others, which is most of what the test costs, device by device."""
STARTS = {
    "xela_uskin": ["start"],
    "icub_skin": ["start"],
}
"""Commands that make a device stream; others are asked for every documented answer once."""
CONVERTS_WHEN_ASKED = f"{Path(__file__).parents[1] / 'devices' / 'on_request.py'}:OnRequest"


def tables(name: str) -> dict:
    """The device's default scene with noise on its taxels."""
    data = file.default_scene(name).tables.model_dump(by_alias=True, exclude_none=True)
    (skin,) = data["skin"]
    data["scene"] |= {} if name in SECONDS else {"dt": STEP_S}
    skin |= {"name": name.rpartition(":")[2], "options": skin["options"] | {"noise": 1e-3}}
    return data


def beside(data: dict, other: dict) -> dict:
    """Both scenes in one, ``other`` a metre away."""
    bodies = [
        body | {"name": f"other {body['name']}", "position": (1.0 + body["position"][0], *body["position"][1:])}
        for body in other["body"]
    ]
    skins = [skin | {"link": f"other {skin['link']}"} for skin in other["skin"]]
    return data | {"body": [*data["body"], *bodies], "skin": [*data["skin"], *skins]}


def digest(data: dict, name: str, seed: int = 1) -> tuple[str, int]:
    """SHA-256 and number of the frames that ``name`` sent."""
    run_options = AssemblyOptions(port="memory:", seed=seed)
    truth = Truth()
    emulator = assemble(file.check(data), run_options, truth=truth).emulator
    emulator.clock = VirtualClock()
    channel = next(c for c in emulator.channels if c.name == name)
    with emulator:
        write = channel.wire.transport.driver.write
        for k, request in enumerate(_requests(channel.device)):
            emulator.at(round((0.2 + 0.05 * k) * 1e9), functools.partial(write, request))
        emulator.run(SECONDS.get(name, 3.5))
    sent = hashlib.sha256()
    frames = [(t_ns, frame) for t_ns, device, frame in truth.frames if device == name]
    for t_ns, frame in frames:
        sent.update(f"{t_ns} {frame!r}".encode())
    return sent.hexdigest(), len(frames)


def _requests(device: fp.Device) -> list:
    commands = device.commands
    chosen = [c for c in commands if c.name in STARTS[device.name]] if device.name in STARTS else commands
    return [frame_of(request) for command in chosen for request in (*command.after, *command.written)]


@pytest.mark.each_device
@pytest.mark.parametrize("name", fp.names())
def test_same_seed_same_bytes_alone_and_among_others(name):
    data = tables(name)
    alone, count = digest(data, name)
    assert count > 0, "nothing was sent"
    other = tables("anyskin" if name != "anyskin" else "xela_uskin")
    assert digest(beside(data, other), name) == (alone, count)


def test_same_seed_same_bytes_of_a_device_that_converts_when_asked():
    """Whoever else samples brings the simulation no further than the moment at which it is asked."""
    data = tables(CONVERTS_WHEN_ASKED)
    alone, count = digest(data, "OnRequest")
    assert count == 20
    assert digest(beside(data, tables("anyskin")), "OnRequest") == (alone, count)


def test_same_seed_same_bytes_run_after_run():
    data = tables("anyskin")
    assert digest(data, "anyskin") == digest(data, "anyskin")


def test_another_seed_gives_other_bytes():
    data = tables("anyskin")
    assert digest(data, "anyskin", seed=1) != digest(data, "anyskin", seed=2)
