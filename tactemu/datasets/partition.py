"""A range of a dataset's environments: simulated, from where it was left, and written shard by shard."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from firmware_protocols.device import VECTORS
from tactemu.base.errors import TactemuError
from tactemu.datasets.shards import STATE, Column, Rows, Shard, Writer, saved, shards_of
from tactemu.datasets.spec import DatasetSpec
from tactemu.datasets.variety import Moves, Starts
from tactemu.plan.thread_pool import cores
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.engine_tables import MujocoTable
from tactemu.scene.file import LoadedScene, load
from tactemu.scene.placement import PlacedSkin
from tactemu.sensors.sensor import Sensor

UNITS = {"force": "N", "pressure": "Pa", "depth": "m", "displacement": "m", "torque": "N m", "touch": ""}
KINDS = {"ideal": True, "measured": False}
"""Whether it is the truth."""
MOST_WRITERS = 6
"""Threads that write shards, each of which holds one in memory."""
TIMED_STEPS = 20
"""By which it is estimated how long all takes."""


def whole_scene(order: DatasetSpec) -> LoadedScene:
    """Return the scene of a dataset.

    Raises:
        TactemuError: it cannot be had, or an engine moves its bodies that knows one environment only.
    """
    loaded = load(order.target)
    if isinstance(loaded.tables.engine, MujocoTable):
        raise TactemuError(
            f'{order.target}: an engine of kind "mujoco" moves one environment; "mujoco-warp" or "newton" moves many'
        )
    return loaded


class Partition:
    """The environments ``first`` to ``end`` of a dataset, built.

    Args:
        order: what is made.
        first: number of the first environment.
        end: of the first that is not.

    Raises:
        TactemuError: the scene cannot be had, or has no skin that feels.
    """

    def __init__(self, order: DatasetSpec, first: int, end: int):
        self._order = order
        loaded = whole_scene(order)
        devices = make_devices(loaded)
        starts = Starts(loaded, order)
        scene, placed = build_scene(replace(loaded, motions={}, starts=starts.of_engine), devices)
        if not placed:
            raise TactemuError(f"{order.target}: no skin is on a body; a dataset is of what skins feel")
        Moves(scene, loaded.motions, starts, first, end)
        world = loaded.tables.scene
        how = {"device": order.device, "seed": order.seed, "dtype": world.dtype, "first_env": first}
        self.simulation = scene.build(end - first, **how)
        self.simulation.step()  # as an emulator begins, which loads the kernels by a step
        self.simulation.reset()
        self._taps = [
            _Tap(name, skin, quantity, kind, world.dtype)
            for name, skin in placed.items()
            for quantity in devices[name].contact
            for kind in KINDS
        ]
        self._hosts = {key: key[0].host_array(key[1]) for tap in self._taps for key in tap.sensors}
        self._posed = [body for body in scene.bodies if body.shape is not None and not body.fixed]
        self.columns = [tap.column for tap in self._taps] + [
            Column(f"pose.{body.name}", (7,), "m", "position and quaternion (w, x, y, z), world", "float64")
            for body in self._posed
        ]
        self.shards = shards_of(order, self.columns, first, end)
        self._begun = self.simulation.state()

    def rows(self) -> Iterator[tuple[str, np.ndarray]]:
        """What is felt now in all environments, by column."""
        for (sensor, truth), host in self._hosts.items():
            wp.copy(host, sensor.array(truth))
        if self.simulation.device.is_cuda:
            wp.synchronize_stream(wp.get_stream(self.simulation.device))
        for tap in self._taps:
            yield tap.column.name, tap.read(self._hosts)
        poses = self.simulation.world.download() if self._posed else np.empty(0)
        for body in self._posed:
            yield f"pose.{body.name}", poses[:, body.index, :7]

    def timed(self) -> float:
        """How long one row takes, to simulate and to fill in [s]; it goes on from its start afterwards."""
        shard = Shard(0, self.simulation.n_envs, 0, 1)
        room = Rows(self.columns, shard)
        start = time.perf_counter()
        for _ in range(TIMED_STEPS):
            for _ in range(self._order.every):
                self.simulation.step()
            room.put(0, 0, 0, self.rows())
        self.simulation.check()
        took = (time.perf_counter() - start) / TIMED_STEPS
        self.simulation.prepare_restore(self._begun)()
        return took

    def write(self, folder: Path) -> Iterator[Shard]:
        """Make what is not there yet; says each shard that is on its way, those of an earlier run too.

        Raises:
            OSError: it cannot be written.
            PoseError: a body's pose is not finite any more.
        """
        state = saved(self.shards[0].path(folder).parent / STATE)
        done = 0
        if state is not None:
            done = state.pop("shards")
            self.simulation.prepare_restore(state)()
        yield from self.shards[:done]
        writer = Writer(folder, self.columns, self._order.compression, min(MOST_WRITERS, max(1, cores() - 1)))
        try:
            for k, shard in enumerate(self.shards[done:], done):
                rows = writer.rows(shard)
                for row in range(shard.first_row, shard.end_row):
                    for _ in range(self._order.every):
                        self.simulation.step()
                    rows.put(row, self.simulation.step_count, self.simulation.time_ns, self.rows())
                self.simulation.check()
                writer.put(rows, {**self.simulation.state(), "shards": k + 1})
                yield shard
            writer.wait()
        finally:
            writer.close()
            self.simulation.close()


class _Tap:
    """One quantity of one skin, ideal or measured, in the order and the frames of its device."""

    def __init__(self, name: str, skin: PlacedSkin, quantity: str, kind: str, dtype: str):
        self._skin, self._quantity, self._truth = skin, quantity, KINDS[kind]
        self.sensors: list[tuple[Sensor, bool]] = [(part.sensor, self._truth) for part in skin.parts]
        vector = quantity in VECTORS
        shape = (skin.n_taxels, 3) if vector else (skin.n_taxels,)
        frame = ", in the frame of the device's link" if vector else ""
        words = "without imperfections" if self._truth else "as the electronics have it"
        kind_of = "bool" if quantity == "touch" else dtype
        meaning = f"{quantity} on each taxel{frame}, {words}"
        self.column = Column(f"{name}.{quantity}.{kind}", shape, UNITS.get(quantity, ""), meaning, kind_of)

    def read(self, hosts: dict[tuple[Sensor, bool], wp.array]) -> np.ndarray:
        """Return all environments, ``(n_envs, n_taxels[, 3])``."""
        found = []
        for part in self._skin.parts:
            values = part.sensor.pick(self._quantity, hosts[part.sensor, self._truth].numpy())
            found.append(part.turned(values) if self.column.shape[1:] else values)
        if len(found) == 1:
            return found[0]
        whole = np.empty((len(found[0]), *self.column.shape), found[0].dtype)
        for part, own in zip(self._skin.parts, found):
            whole[:, part.part.taxels] = own
        return whole
