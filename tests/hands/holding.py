"""A hand that its own SDK moves, in a process of its own, and what MuJoCo says of the grasp.

``python -m tests.hands.holding [HAND] [OBJECT] [POSES]`` has all hands hold all objects from ten starting poses, and
prints a line for each. It takes an hour; docs/hands.md says what is held and what not.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest

import tactemu as tt

HANDS = Path(__file__).parents[2] / "examples" / "hands"
PATIENCE = 10
"""A controller goes on for so much longer than it must, and is ended."""
SETTLE_S, HOLD_S = 3.0, 2.0
"""After the first touch the force settles, and then is held, before it is judged."""


OBJECTS = ("ball", "box", "can", "egg", "soft", "heavy")
HEAVY_N = 2.5
"""A heavy box of 250 g slips below 1.6 N."""


@dataclass(frozen=True)
class Hand:
    """A hand that is tested."""

    name: str
    package: str
    pads: tuple[str, ...]
    """Geoms of the outer links that hold; thumb first."""
    port: str | None = None
    resolution_n: float = 0.0
    """Two counts of its touch."""
    newtons: dict[str, float] = field(default_factory=dict)
    """Set forces, where not 1 N."""

    egg_n: float = 2.5
    """What breaks the egg."""
    script: str = ""
    """Of the hand whose controller is meant, where it is another's."""
    options: tuple[str, ...] = ()
    """For the controller."""

    def address(self, dev: tt.Served) -> list[str]:
        """What its controller is told to open."""
        if self.package == "linkerbot":
            return [dev.can["channel"], dev.can["interface"]]
        return list(dev.ports.values())


PADS = ("thumb_tip", "index_tip")
ALL = {
    "linker_l6": Hand("linker_l6", "linkerbot", PADS, resolution_n=2 / 500),
    "linker_o6": Hand(
        "linker_o6", "linkerbot", PADS, resolution_n=2 / 500, script="linker_l6", options=("--hand", "O6")
    ),
    "ability_hand": Hand("ability_hand", "ah_wrapper", PADS, newtons=dict.fromkeys(OBJECTS, 8.0), egg_n=12.0),
    "inspire_rh56dftp": Hand("inspire_rh56dftp", "RH56DFTP", PADS, "tcp:0", 2 / 1000),
    "paxini_gripper": Hand(
        "paxini_gripper",
        "paxini_sdk",
        ("left_pad", "right_pad"),
        resolution_n=2 / 10,
        newtons=dict.fromkeys(OBJECTS, 2.0) | {"heavy": 4.0},
        egg_n=5.0,
    ),
}


@dataclass
class Held:
    """What came of a grasp."""

    forces: np.ndarray
    """Of MuJoCo's contacts on each pad [N], mean of the last 0.2 s."""
    height: float
    """Of the object over where it began [m]."""
    broken: list[str]
    statistics: dict

    def right(self, newtons: float, resolution_n: float) -> bool:
        """Whether it holds as hard as it should, the mean of both pads as controlled, and the object is still there."""
        off = abs(float(self.forces.mean()) - newtons)
        return off <= max(0.1 * newtons, resolution_n) and abs(self.height) < 0.005 and not self.broken


def newtons_of(hand: Hand, thing: str) -> float:
    """How hard a hand is to hold a thing."""
    return hand.newtons.get(thing, HEAVY_N if thing == "heavy" else 1.0)


def poses(count: int, seed: int = 0) -> np.ndarray:
    """Starting poses: along x, y [m], and about the vertical [rad]."""
    spread = np.array([0.002, 0.0008, 0.05])
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * spread


def scene_of(hand: Hand, thing: str, folder: Path, more: str = "") -> Path:
    """The example's scene with another object."""
    model = folder / f"{hand.name}_{thing}.xml"
    model.write_text(
        f'<mujoco><include file="{HANDS / hand.name}.xml"/><include file="{HANDS / "objects" / thing}.xml"/></mujoco>'
    )
    text = (HANDS / f"{hand.name}.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("port =")]
    text = "\n".join(f'file = "{model}"' if line.startswith("file =") else line for line in lines)
    if thing == "egg":
        text = text.replace("[engine]\n", f"[engine]\nbreaks = {{ object = {hand.egg_n} }}\n")
    scene = folder / f"{hand.name}_{thing}.toml"
    scene.write_text(text + more)
    return scene


def engine_of(dev: tt.Served):
    """The MuJoCo engine of what is served."""
    return dev.simulation.posers[0].__self__


def contact_forces(engine, names) -> np.ndarray:
    """MuJoCo's normal forces of contact on the body of each geom, their sum's length [N]."""
    model, data, wrench = engine.model, engine.data, np.zeros(6)
    ids = [int(model.geom_bodyid[model.geom(name).id]) for name in names]
    totals = np.zeros((len(ids), 3))
    for k, contact in enumerate(data.contact[: data.ncon]):
        mujoco.mj_contactForce(model, data, k, wrench)
        force = wrench[0] * contact.frame[:3]
        for geom, sign in ((contact.geom1, -1), (contact.geom2, 1)):
            if (body := int(model.geom_bodyid[geom])) in ids:
                totals[ids.index(body)] += sign * force
    return np.linalg.norm(totals, axis=1)


def until(engine, t_s: float) -> None:
    """Wait until the model has come to a time: on a busy machine it is slower than the clock."""
    deadline = time.monotonic() + 60
    while engine.data.time < t_s:
        assert time.monotonic() < deadline, "the model has come to a stand"
        time.sleep(0.005)


def put(engine, pose) -> None:
    """Start the object elsewhere."""
    x, y, yaw = pose
    joint = engine.model.jnt_qposadr[engine.model.body_jntadr[engine.model.body("object").id]]
    engine.data.qpos[joint : joint + 2] += (x, y)
    engine.data.qpos[joint + 3 : joint + 7] = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))


@contextmanager
def controller(hand: Hand, dev: tt.Served, *options, does: str = "grasp") -> Iterator[subprocess.Popen]:
    """The example's controller, as a process that tells by a line that it touches."""
    if importlib.util.find_spec(hand.package) is None:
        pytest.skip(f"{hand.package} is not installed")
    script = HANDS / f"{does}_{hand.script or hand.name}.py"
    command = [sys.executable, str(script), *hand.address(dev), *hand.options, *map(str, options)]
    with (
        TemporaryDirectory() as folder,  # drivers leave files where they are started
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def hold(
    hand: Hand, thing: str, pose, folder: Path, *, settle_s=SETTLE_S, hold_s=HOLD_S, late_s=0.0, dead=(), faults=()
) -> Held:
    """Have the hand hold a thing, whose table goes away half-way.

    On a busy machine a controller acts late: the force may take ``late_s`` longer to become right.
    """
    newtons = newtons_of(hand, thing)
    scene = scene_of(hand, thing, folder)
    with tt.serve(scene, hand.port, faults=faults, adjustable=["dead"]) as dev:
        engine = engine_of(dev)
        dev.in_loop(lambda: put(engine, pose))
        z = engine.data.body("object").xpos[2]
        if len(dead):
            dev.dead(list(dead), 0.0)
        seconds = PATIENCE * (settle_s + hold_s)
        with controller(hand, dev, "--newtons", newtons, "--seconds", seconds) as process:
            assert process.stdout is not None and process.stderr is not None
            touched = next((line for line in process.stdout if line.startswith("{")), "")  # drivers print, too
            assert touched, process.stderr.read()[-2000:]
            if "touched" in json.loads(touched):
                begin = engine.data.time
                until(engine, begin + settle_s / 2)
                dev.move((0, 0, -0.2), body="table", speed=0.3, wait=False)
                until(engine, begin + settle_s + hold_s - 0.2)
            end = engine.data.time + late_s
            held = _held(hand, dev, z)
            while not held.right(newtons, hand.resolution_n) and engine.data.time < end:
                held = _held(hand, dev, z)
            assert process.poll() is None, "the controller has given up"
        return held


def _held(hand: Hand, dev: tt.Served, z: float) -> Held:
    """Look for 0.2 s; ``z`` is where the object began [m]."""
    engine, seen = engine_of(dev), []
    for _ in range(10):
        dev.in_loop(lambda: seen.append(contact_forces(engine, hand.pads)))
        until(engine, engine.data.time + 0.02)
    height = float(engine.data.body("object").xpos[2] - z)
    return Held(np.mean(seen, axis=0), height, engine.broken, dev.stats())


def main() -> int:
    """All of it."""
    given = sys.argv[1:]
    hands = [ALL[name] for name in given if name in ALL] or list(ALL.values())
    things = [name for name in given if name in OBJECTS] or list(OBJECTS)
    count = next((int(word) for word in given if word.isdigit()), 10)
    failed = 0
    for hand in hands:
        for thing in things:
            good, worst = 0, 0.0
            for pose in poses(count):
                with TemporaryDirectory() as folder:
                    held = hold(hand, thing, pose, Path(folder))
                want = newtons_of(hand, thing)
                good += held.right(want, hand.resolution_n)
                worst = max(worst, float(np.abs(held.forces / want - 1).max()))
                print(f"  {held.forces.round(3)} N, {held.height * 1e3:+.2f} mm", flush=True)
            failed += good < count
            print(f"{hand.name} holds the {thing} {good} of {count}, worst force {worst:+.1%}", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
