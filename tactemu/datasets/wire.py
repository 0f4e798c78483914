"""What the wire says of one environment of a dataset: its emulator, run in virtual time, and its truth log."""

from __future__ import annotations

from pathlib import Path

from tactemu.base.clock import VirtualClock
from tactemu.base.files import move_into_place
from tactemu.datasets.partition import whole_scene
from tactemu.datasets.spec import DatasetSpec
from tactemu.datasets.variety import Starts
from tactemu.emulator.assembly import RunOptions, assemble, truth_of

FOLDER = "wire"


def path_of(folder: Path, env: int) -> Path:
    """Where the log of an environment is."""
    return folder / FOLDER / f"env-{env:06d}.mcap"


def write_wire(order: DatasetSpec, env: int, folder: Path) -> None:
    """Run the emulator of an environment for as long as the dataset is; the log is there once it is whole.

    Raises:
        TactemuError: it cannot be assembled or written.
    """
    loaded = Starts(whole_scene(order), order).of(env)
    path = path_of(folder, env)
    path.parent.mkdir(parents=True, exist_ok=True)
    begun = path.with_name(f".begun-{path.name}")
    run_options = RunOptions(port="memory:", seed=order.seed, compute=order.device, env=env, fresh_ports=True)
    truth = truth_of(loaded, begun, keep=0)
    with assemble(loaded, run_options, clock=VirtualClock(), truth=truth).emulator as emulator:
        emulator.run(order.steps * loaded.tables.scene.dt)
    move_into_place(begun, path)
