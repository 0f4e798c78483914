"""The wire log of one environment of a dataset: the truth log of its emulator, run in virtual time."""

from __future__ import annotations

from pathlib import Path

from tactemu.base.files import move_into_place
from tactemu.datasets.partition import load_scene
from tactemu.datasets.spec import DatasetSpec
from tactemu.datasets.start_poses import StartPoses
from tactemu.session.options import RunOptions
from tactemu.session.session import Session

FOLDER = "wire"


def path_of(folder: Path, env: int) -> Path:
    """Return the path of an environment's wire log."""
    return folder / FOLDER / f"env-{env:06d}.mcap"


def write_wire_log(spec: DatasetSpec, env: int, folder: Path) -> None:
    """Run the emulator of an environment for the duration of the dataset, and write its log.

    The log appears under its name once it is complete.

    Raises:
        TactemuError: the emulator cannot be assembled, or the log cannot be written.
    """
    loaded = StartPoses(load_scene(spec), spec).of(env)
    path = path_of(folder, env)
    path.parent.mkdir(parents=True, exist_ok=True)
    begun = path.with_name(f".begun-{path.name}")
    options = RunOptions(
        port="memory:", seed=spec.seed, device=spec.device, env=env, fresh_ports=True, truth=begun, keep=0,
        clock="virtual", seconds=spec.steps * loaded.tables.scene.dt,
    )  # fmt: skip
    with Session(loaded, options) as session:
        session.open().run()
    move_into_place(begun, path)
