"""Compare what two trees transmit and measure: every device, every sensor model, every client recording.

The probe below runs unchanged in both trees, through names that both have: the command line and the scene of the public
API. Each case is a truth log as JSON lines (ideal, measured, counts, bytes, faults, poses, summary) or an array of
readings; equal means equal byte for byte.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

TREE = Path(__file__).parent.parent
BASE = "a5840a9"
"""The last commit before the rooms and names of the tree were tidied."""
SECONDS = 0.3
"""Virtual length of each device's run."""
HAND_SECONDS = 7
"""Virtual length of the example with two skins: all its events are over."""
VARIANTS = ((), ("--measured",), ("--fault", "drop 10%"), ("--fault", "flip 10%"))
"""Further words of each device's runs. What a device or line cannot have is refused, in both trees alike."""
DIGEST_LENGTH = 64
"""Hexadecimal digits of a SHA-256; another answer of the probe is a refusal."""
PROBE = """
import contextlib, hashlib, inspect, io, json, re, sys
from pathlib import Path
import numpy as np
import tactemu as tt
from tactemu.cli.app import app

try:
    from tactemu.base.option_groups import from_flat
except ImportError:  # a base whose models take all options side by side
    from_flat = lambda model, options: model(**options)
WAS = {"positions": "probe_local_pos", "radius": "probe_radius"}

def make(model, options):
    own = model.__dataclass_fields__  # a base has other names
    return from_flat(model, {name if name in own or name not in WAS else WAS[name]: options[name] for name in options})

def run(name, words, folder):
    log = Path(folder) / f"{name}.jsonl"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            app([*words, "--truth", str(log)], standalone_mode=False)
        except SystemExit as ended:
            if ended.code: return f"exit code {ended.code}"
    # The base logs a fault's frame number only in the text of the fault.
    return hashlib.sha256(re.sub(rb'(?<=\\]"),"frame":\\d+', b"", log.read_bytes())).hexdigest()

def read(model, options):
    line = np.linspace(-0.008, 0.008, 12)
    grid = np.stack([*np.meshgrid(line, line), np.full((12, 12), 0.005)], axis=-1)
    signs = {"convention": "genesis"} if "convention" in inspect.signature(tt.Scene).parameters else {}
    scene = tt.Scene(dt=1e-3, **signs)
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True, name="pad")
    shapes = tt.Sphere(radius=0.01), tt.Box(size=(0.008,) * 3), tt.Capsule(radius=0.004, length=0.01)
    bodies = [scene.add_body(shape, name=type(shape).__name__) for shape in shapes]
    # Bodies that come from the side at different depths, turning.
    sensor = scene.add_sensor(make(getattr(tt, model), {"positions": grid, **options}), link=pad)
    sim = scene.build(n_envs=2, seed=3)
    seen = hashlib.sha256()
    for step in range(60):
        for k, body in enumerate(bodies):
            turn = 0.01 * step * (k + 1)
            place = [(k - 1) * 0.006 + 2e-5 * step, 1e-4 * k, 0.0142 - 1e-5 * step + 3e-4 * k]
            turned = [np.cos(turn), 0, 0, np.sin(turn)]
            sim.set_pose(body, position=np.array([place] * 2), quaternion=np.array([turned] * 2))
        sim.step()
        for reading in (sensor.read(), sensor.read_ground_truth()):
            for values in reading if isinstance(reading, tuple) else (reading,):
                seen.update(np.ascontiguousarray(values).tobytes())
    return seen.hexdigest()

for line in sys.stdin:
    kind, name, *more = json.loads(line)
    try:
        found = {"run": run, "read": read}[kind](*more)
    except Exception as error:
        found = type(error).__name__  # messages may read otherwise
    print(json.dumps([name, found]), file=sys.__stdout__, flush=True)
"""
MODELS = {
    "ContactProbe": {},
    "ContactDepthProbe": {"radius": 0.001, "noise": 1e-5},
    "KinematicTaxel": {
        "radius": 0.001,
        "normal_stiffness": 400.0,
        "shear_scalar": 1.0,
        "noise": 0.002,
        "hysteresis_strength": 0.1,
        "dead_taxel_probability": 0.02,
        "delay": 2e-3,
    },
    "ProximityTaxel": {"n_sample_points": 500, "twist_scalar": 1.0, "noise": 0.002},
    "ElastomerTaxel": {"shear_scale": 1.0, "crosstalk_strength": 0.1, "crosstalk_sigma": 0.002, "resolution": 1e-6},
    "ElasticLayerTaxel": {"friction": 0.5, "noise": 0.002},
}
"""Options with which each model is read."""


def export(commit: str, folder: Path) -> None:
    """Write the files of a commit into a folder."""
    archive = subprocess.run(["git", "archive", commit], cwd=TREE, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=BytesIO(archive)) as files:
        files.extractall(folder, filter="data")


def cases(folder: str, devices: list[str]) -> list[list[object]]:
    """Return the cases as the probe takes them: kind, name, arguments."""
    common = ["--clock", "virtual", "--seed", "1", "--json"]
    found: list[list[object]] = []
    for name in devices:
        words = ["run", name, "--port", "memory:", "--seconds", str(SECONDS), *common]
        for number, more in enumerate(VARIANTS):
            found.append(["run", " ".join([name, *more]), f"{name}-{number}", [*words, *more], folder])
    ports = ["--port", "fingertip=memory:", "--port", "palm=memory:"]
    hand = ["run", "examples/hand.toml", *ports, "--seconds", str(HAND_SECONDS), *common]
    found.append(["run", hand[1], "hand", hand, folder])
    return found + [["read", model, model, options] for model, options in MODELS.items()]


def answers(tree: Path, asked: list[list[object]], echo: Callable[[str], None]) -> dict[str, str]:
    """Run the probe in a tree and return its answer to each case."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    probe = subprocess.Popen(
        [sys.executable, "-c", PROBE],
        cwd=tree,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert probe.stdin is not None and probe.stdout is not None
    found: dict[str, str] = {}
    with probe:
        for case in asked:
            probe.stdin.write(json.dumps(case) + "\n")
            probe.stdin.flush()
            line = probe.stdout.readline()
            if not line:
                raise RuntimeError(f"the probe in {tree} ended at {case[1]}")
            name, answer = json.loads(line)
            found[name] = answer
        probe.stdin.close()
    echo(f"{len(found)} cases in {tree}")
    return found


def recordings(tree: Path) -> dict[str, bytes]:
    """Return the client recordings of a tree and their bytes, by file name."""
    return {file.name: file.read_bytes() for file in sorted((tree / "tests/data/clients").glob("*.mcap"))}


def run(echo: Callable[[str], None], commit: str = BASE, replay: bool = True) -> bool:
    """Compare this tree with a commit; return True if nothing differs.

    Args:
        echo: takes the lines of the report.
        commit: the commit to compare with.
        replay: replay the client recordings of that commit in this tree, too (a minute).
    """
    import firmware_protocols

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (base := folder / "base").mkdir()
        (logs := folder / "logs").mkdir()
        export(commit, base)
        asked = cases(str(logs), sorted(firmware_protocols.DEVICES))
        before, now = (answers(tree, asked, echo) for tree in (base, TREE))
        differing = [case for case in before if before[case] != now[case]]
        for case in differing:
            echo(f"differs: {case}: {before[case][:160]} | {now[case][:160]}")
        refused = [answer for answer in now.values() if len(answer) != DIGEST_LENGTH]
        echo(f"{len(before) - len(differing)} of {len(before)} cases are equal, {len(refused)} of them refusals:")
        for reason, count in Counter(refused).items():
            echo(f"  {count} x {reason}")
        ours, theirs = recordings(TREE), recordings(base)
        altered = [file for file, data in theirs.items() if ours.get(file) != data]
        echo(f"{len(theirs) - len(altered)} of {len(theirs)} client recordings of {commit} are here, unaltered")
        replayed = (
            not replay
            or not subprocess.run(
                [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/clients"], cwd=TREE, check=False
            ).returncode
        )
        return not differing and not altered and replayed
