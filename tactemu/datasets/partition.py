"""A range of a dataset's environments, simulated from where it was interrupted and written shard by shard."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from firmware_protocols.senses import QUANTITY_UNITS, VECTORS
from tactemu.base.errors import TactemuError
from tactemu.datasets.shards import STATE, Column, RowBuffer, Shard, Writer, saved, shards_of
from tactemu.datasets.spec import DatasetSpec
from tactemu.datasets.start_poses import BodyMotions, StartPoses
from tactemu.plan.thread_pool import cores
from tactemu.scene.building import build_scene, build_simulation, make_devices
from tactemu.scene.engine_tables import BatchTable
from tactemu.scene.file import LoadedScene, load
from tactemu.scene.placement import PlacedSkin
from tactemu.sensors.arrays import pick
from tactemu.sensors.sensor import Sensor, reading_array

IS_TRUTH = {"ideal": True, "measured": False}
"""The kinds of readings in a dataset, and whether they are without imperfections."""
MAX_WRITER_THREADS = 6
"""Maximum number of threads that write shards; bounds the memory, since each holds one shard."""
TIMED_ROWS = 20
"""Number of rows by which the time of the whole dataset is estimated."""


def load_scene(spec: DatasetSpec) -> LoadedScene:
    """Return the scene of a dataset.

    Raises:
        TactemuError: the scene cannot be loaded, or its engine simulates one environment only.
    """
    loaded = load(spec.target)
    engine = loaded.tables.engine
    if engine is not None and not isinstance(engine, BatchTable):
        raise TactemuError(
            f'{spec.target}: an engine of kind "{engine.kind}" simulates one environment; use "mujoco-warp" or "newton"'
        )
    return loaded


class Partition:
    """The simulation of the environments ``first`` to ``end - 1`` of a dataset.

    Args:
        spec: of the dataset.
        first: number of the first environment.
        end: number of the last environment, plus one.

    Raises:
        TactemuError: the scene cannot be loaded, or has no skin on a body.
    """

    def __init__(self, spec: DatasetSpec, first: int, end: int):
        self._spec = spec
        loaded = load_scene(spec)
        devices = make_devices(loaded)
        starts = StartPoses(loaded, spec)
        scene, placed = build_scene(replace(loaded, motions={}, starts=starts.of_engine), devices)
        if not placed:
            raise TactemuError(f"{spec.target}: no skin is on a body; add a [[skin]] with a link")
        BodyMotions(scene, loaded.motions, starts, first, end)
        self.simulation = build_simulation(
            scene, loaded, end - first, device=spec.device, seed=spec.seed, first_env=first
        )
        self.simulation.step()  # loads the kernels, as the first step of an emulator does
        self.simulation.reset()
        self._readers = [
            _QuantityReader(name, skin, quantity, kind, loaded.tables.scene.dtype)
            for name, skin in placed.items()
            for quantity in devices[name].contact
            for kind in IS_TRUTH
        ]
        self._hosts = {key: key[0].host_array(key[1]) for reader in self._readers for key in reader.sensors}
        self._posed = [body for body in scene.bodies if body.shape is not None and not body.fixed]
        self.columns = [reader.column for reader in self._readers] + [
            Column(f"pose.{body.name}", (7,), "m", "position and quaternion (w, x, y, z), world", "float64")
            for body in self._posed
        ]
        self.shards = shards_of(spec, self.columns, first, end)
        self._begun = self.simulation.state()

    def rows(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the name of each column and its present values in all environments."""
        for (sensor, truth), host in self._hosts.items():
            wp.copy(host, reading_array(sensor, truth))
        if self.simulation.device.is_cuda:
            wp.synchronize_stream(wp.get_stream(self.simulation.device))
        for reader in self._readers:
            yield reader.column.name, reader.read(self._hosts)
        poses = self.simulation._world.download() if self._posed else np.empty(0)
        for body in self._posed:
            yield f"pose.{body.name}", poses[:, body.index, :7]

    def timed(self) -> float:
        """Return the time to simulate and buffer one row [s]; the simulation is back at its start afterwards."""
        shard = Shard(0, self.simulation.n_envs, 0, 1)
        buffer = RowBuffer(self.columns, shard)
        start = time.perf_counter()
        for _ in range(TIMED_ROWS):
            for _ in range(self._spec.every):
                self.simulation.step()
            buffer.put(0, 0, 0, self.rows())
        self.simulation.check()
        took = (time.perf_counter() - start) / TIMED_ROWS
        self.simulation.prepare_restore(self._begun)()
        return took

    def write(self, folder: Path) -> Iterator[Shard]:
        """Generate the missing shards; yield each shard once it is handed to a writer, those of an earlier run first.

        Raises:
            OSError: a shard cannot be written.
            PoseError: a body's pose is no longer finite.
        """
        state = saved(self.shards[0].path(folder).parent / STATE)
        done = 0
        if state is not None:
            done = state.pop("shards")
            self.simulation.prepare_restore(state)()
        yield from self.shards[:done]
        writer = Writer(folder, self.columns, self._spec.compression, min(MAX_WRITER_THREADS, max(1, cores() - 1)))
        try:
            for k, shard in enumerate(self.shards[done:], done):
                rows = writer.rows(shard)
                for row in range(shard.first_row, shard.end_row):
                    for _ in range(self._spec.every):
                        self.simulation.step()
                    rows.put(row, self.simulation.step_count, self.simulation.time_ns, self.rows())
                self.simulation.check()
                writer.put(rows, {**self.simulation.state(), "shards": k + 1})
                yield shard
            writer.wait()
        finally:
            writer.close()
            self.simulation.close()


class _QuantityReader:
    """One quantity of one skin, ideal or measured, in the order and the frames of its device."""

    def __init__(self, name: str, skin: PlacedSkin, quantity: str, kind: str, dtype: str):
        self._skin, self._quantity, self._truth = skin, quantity, IS_TRUTH[kind]
        self.sensors: list[tuple[Sensor, bool]] = [(part.sensor, self._truth) for part in skin.parts]
        vector = quantity in VECTORS
        shape = (skin.n_taxels, 3) if vector else (skin.n_taxels,)
        frame = ", in the frame of the device's link" if vector else ""
        words = "without imperfections" if self._truth else "as the electronics measure it"
        kind_of = "bool" if quantity == "touch" else dtype
        signs = "" if all(sensor.on_skin for sensor, _ in self.sensors) else ", with the signs of Genesis"
        meaning = f"{quantity} on each taxel{frame}{signs}, {words}"
        self.column = Column(f"{name}.{quantity}.{kind}", shape, QUANTITY_UNITS[quantity], meaning, kind_of)

    def read(self, hosts: dict[tuple[Sensor, bool], wp.array]) -> np.ndarray:
        """Return the values in all environments, shape ``(n_envs, n_taxels[, 3])``."""
        found = []
        for part in self._skin.parts:
            values = pick(part.sensor, self._quantity, hosts[part.sensor, self._truth].numpy())
            values = values > 0 if self._quantity == "touch" else values
            found.append(part.to_device_frame(values) if self.column.shape[1:] else values)
        if len(found) == 1:
            return found[0]
        joined = np.empty((len(found[0]), *self.column.shape), found[0].dtype)
        for part, own in zip(self._skin.parts, found):
            joined[:, part.part.taxels] = own
        return joined
