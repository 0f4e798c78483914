"""What each page takes for granted: the reader's own files, names of fragments of Python, and tables of a scene."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.documents.blocks import ROOT, blocks_of

READERS = Path(__file__).parent / "readers"
"""Programs that stand for the reader's driver."""
START = ROOT / "tactemu" / "scene" / "start.toml"
"""The scene that ``tactemu new`` writes."""


@dataclass
class Reader:
    """A reader of a page: the names that fragments use, and how the commands of a page fit this machine."""

    folder: Path
    names: dict[str, Any] = field(default_factory=dict)
    replaced: list[tuple[str, str]] = field(default_factory=list)

    def on_this_machine(self, text: str) -> str:
        """Return a block with what this machine has: its own ports, few environments, a CPU."""
        for old, new in [("/tmp/", f"{self.folder}/"), *self.replaced]:
            text = text.replace(old, new)
        return text

    def copy(self, source: str, name: str) -> None:
        """Have a program of ``readers`` under a name."""
        shutil.copy(READERS / source, self.folder / name)
        (self.folder / name).chmod(0o755)

    def scene(self, *changes: tuple[str, str]) -> None:
        """Have ``hand.toml`` as `tactemu new` writes it, with changes."""
        text = START.read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (self.folder / "hand.toml").write_text(text)


SMALL = [("n_envs=4096", "n_envs=4"), ("num_envs=4096", "num_envs=4"), ("build(4096", "build(4"), ("cuda:0", "cpu")]


def prepare(page: str, folder: Path) -> Reader:
    """Return the reader of a page, with the files in a folder."""
    import tactemu

    reader = Reader(folder, {"tactemu": tactemu, "tt": tactemu, "np": np})
    reader.scene()
    for name in ("driver.py", "my_driver.py", "reader"):
        reader.copy("anyskin.py", name)
    PAGES.get(page, lambda _: None)(reader)
    return reader


def of_the_tutorial() -> str:
    """Return the driver with which the tutorial ends."""
    page = ROOT / "docs" / "tutorial.md"
    return [block.text for block in blocks_of(page) if block.name == "driver.py"][-1]


def readme(reader: Reader) -> None:
    exec(of_the_tutorial(), names := {"__name__": "driver"})
    reader.names["MyDriver"] = names["ForceSensor"]


def batches(reader: Reader) -> None:
    """Arrays of NumPy stand for those of torch and of another simulator."""
    from types import SimpleNamespace

    import warp as wp

    n = 32
    few = [(old, new.replace("4", str(n))) for old, new in SMALL]
    few += [('"cuda:1"', '"cpu"'), ("build_split(8192", f"build_split({n}"), ("range(1000)", "range(3)")]
    reader.replaced += few
    reader.names["positions"] = np.tile((0.0, 0.0, 0.03), (n, 1))
    reader.names |= {"hand": SimpleNamespace(index=1), "policy": lambda force: 0.0}
    reader.names["done"] = wp.array(np.arange(n) < 2, dtype=wp.bool, device="cpu")
    reader.names["numbers"] = wp.array(np.arange(n), dtype=wp.int64, device="cpu")
    reader.names["torch"] = SimpleNamespace(from_dlpack=lambda array: array.numpy())


def can(reader: Reader) -> None:
    reader.copy("can0.py", "my_driver.py")
    reader.scene(("anyskin", "linker_hand_l6"), ("[[skin]]", '[[skin]]\nname = "arm"'))
    (reader.folder / "hand.toml").rename(reader.folder / "robot.toml")
    reader.copy("can3.sh", "reader")


def ci(reader: Reader) -> None:
    (reader.folder / "tests" / "can").mkdir(parents=True)
    program = (READERS / "can0.py").read_text()
    (reader.folder / "tests" / "can" / "test_it.py").write_text(f"def test_an_answer():\n    exec({program!r})\n")


def commands(reader: Reader) -> None:
    reader.copy("tsf85.py", "quick_start.py")
    record(reader, "real.mcap")


def exec_page(reader: Reader) -> None:
    import subprocess

    reader.names["subprocess"] = subprocess
    reader.scene(("[[skin]]", TWO_SKINS))
    reader.copy("first_port.py", "reader")


def imperfections(reader: Reader) -> None:
    import tactemu as tt

    scene = tt.Scene(dt=1e-3)
    x = np.linspace(-0.01, 0.01, 4)
    reader.names |= {"scene": scene, "pad": scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)}
    reader.names["grid"] = np.stack([*np.meshgrid(x, x), np.full((4, 4), 0.01)], axis=-1)


def infer(reader: Reader) -> None:
    record(reader, "presses.mcap", seconds=20.0)


def judge(reader: Reader) -> None:
    (reader.folder / "my_driver.py").write_text(of_the_tutorial())
    (reader.folder / "mypkg").mkdir()
    reader.copy("anyskin.py", "mypkg/driver.py")


def live_control(reader: Reader) -> None:
    testing(reader)
    reader.names["trajectory"] = [(0, 0, 0.03), (0, 0, 0.02)]


def testing(reader: Reader) -> None:
    import pytest

    from tests.documents.readers.anyskin import MyDriver

    class Simulator:
        def run_to(self, t):
            return np.full(5, min(t, 1.0))

    reader.names |= {"MyDriver": MyDriver, "pytest": pytest, "my_simulator": Simulator()}
    reader.copy("can0.py", "driver.py")


def transducers(reader: Reader) -> None:
    """Three presses of 200 g."""
    t = np.arange(0, 40, 0.02)
    mass = np.clip(np.sin(t / 2), 0, 0.8) * 250
    rng = np.random.default_rng(0)
    field = mass[:, None] * np.linspace(0.1, 0.4, 15) + rng.normal(0, 3, (len(t), 15))
    names = ["t_s", "mass_g", *(f"b{chip}{axis}" for chip in range(5) for axis in "xyz")]
    np.savetxt(reader.folder / "presses.csv", np.c_[t, mass, field], delimiter=",", header=",".join(names), comments="")


def truth_log(reader: Reader) -> None:
    reader.scene(("anyskin", "matsense"), ("[[skin]]", '[[skin]]\nname = "thumb"\nport = "memory:"'))


def usb(reader: Reader) -> None:
    reader.names["REPORTS"] = bytes.fromhex("06 00 FF 09 01 A1 01 15 00 25 FF 75 08 95 40 09 01 81 02 C0")


def wire(reader: Reader) -> None:
    from tactemu.wire.faults import fault, frames

    reader.names |= {name: value for module in (fault, frames) for name, value in vars(module).items()}
    record(reader, "anyskin.mcap")


def record(reader: Reader, name: str, seconds: float = 0.5) -> None:
    """Have a recording of an AnySkin."""
    from tests.cli.command import here

    run = ("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", str(seconds), "--truth", name)
    assert here(*run, cwd=reader.folder).returncode == 0


PAGES: dict[str, Callable[[Reader], None]] = {
    "README.md": readme,
    "batches.md": batches,
    "can.md": can,
    "ci.md": ci,
    "commands.md": commands,
    "exec.md": exec_page,
    "gymnasium.md": lambda reader: reader.replaced.extend(SMALL),
    "imperfections.md": imperfections,
    "infer.md": infer,
    "judge.md": judge,
    "live-control.md": live_control,
    "testing-a-driver.md": testing,
    "transducers.md": transducers,
    "truth-log.md": truth_log,
    "usb.md": usb,
    "wire.md": wire,
}

TWO_SKINS = """[[skin]]
device = "anyskin"
name = "thumb"
link = "pad"
position = [0.0, 0.0, 0.003]

[[skin]]
name = "palm"
"""


def completed(data: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a fragment with those that it leaves out."""
    ball = {"shape": "sphere", "radius": 0.01}
    bodies = [
        {"name": f"body{n}"} | ({} if "shape" in each else ball) | each for n, each in enumerate(data.get("body", []))
    ]
    skins = [{"device": "anyskin"} | each for each in data.get("skin", [{"link": "pad"}])]
    named = {body["name"] for body in bodies}
    links = {skin["link"] for skin in skins if "link" in skin} - named
    bodies += [{"name": link, "shape": "frame", "fixed": True} for link in sorted(links)]
    return data | {"body": bodies, "skin": skins}
