"""A hand in a closed loop of motors, MuJoCo and skins, and the script by which it grasps."""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

import functools

from firmware_protocols import CanFrame
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.scene.steering import steered
from tests.hands.holding import ALL, scene_of

L6 = ALL["linker_l6"]
MS = 1_000_000
OPEN, CLOSED, THUMB = 255, 0, 32


def frame(*data: int) -> CanFrame:
    return CanFrame(arbitration_id=0x28, data=bytes(data))


def made(scene, clock=None, truth=None, **options):
    """Return the emulator of a scene, its simulation and its engine."""
    loaded = steered(file.load(scene))
    whole = assemble(
        loaded, AssemblyOptions(port="memory:", seed=5, **options), clock=clock or VirtualClock(), truth=truth
    )
    return whole.emulator, whole.simulation, whole.simulation.posers[0].__self__


def grasping(emulator, *, torque: int = 25, close_s: float = 0.8) -> None:
    """Have the hand grasp by a script: frames and their times."""
    write = emulator.channels[0].wire.transport.driver.write
    orders = [
        (0.01, (0x05, *[128] * 6)),
        (0.02, (0x02, 255, 255, torque, 255, 255, 255)),
        (0.03, (0x01, THUMB, *[OPEN] * 5)),
        (close_s, (0x01, THUMB, OPEN, CLOSED, OPEN, OPEN, OPEN)),
        *((1.0 + 0.05 * k, (0xB1 + k % 5, 0xC6)) for k in range(40)),
        *((1.01 + 0.05 * k, (code,)) for k, code in enumerate([0x01, 0x35, 0x36] * 10)),
    ]
    for t_s, data in orders:
        emulator.at(round(t_s * 1e9), functools.partial(write, frame(*data)))


def replaced(folder, old: str, new: str, thing: str = "ball"):
    """Return the path of a scene in which a text is replaced."""
    scene = scene_of(L6, thing, folder)
    text = scene.read_text()
    assert old in text
    scene.write_text(text.replace(old, new))
    return scene
