"""Views of a sensor's arrays on the device, by the quantity's name.

A view copies nothing and does not wait, and the next step writes into it. One conversion by
``torch.from_dlpack(skin.force_array)``, or that of JAX, CuPy or NumPy, stays valid for all steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.geometry.device_arrays import view
from tactemu.sensors.sensor_model import Derive


def columns_of(sensor: Any) -> dict[str, slice]:
    """Return the channels of each quantity, by name."""
    found: dict[str, slice] = {}
    if sensor.chain is None:
        first = 0
        for kind in sensor.model.channels:
            width = 1 if kind == "scalar" else 3
            if kind != "scalar":
                found[kind] = slice(first, first + width)
            first += width
    return found | dict(sensor.layouts)


def in_layout(array: wp.array, columns: slice, layout: tuple[int, ...], batched: bool) -> wp.array:
    """Return a view of some channels of ``(n_envs, [history,] n_taxels, channels)``, taxels in their layout.

    With a history the taxels stay in one row, since an array has at most four axes.
    """
    first, last, _ = columns.indices(array.shape[-1])
    *outer, n_taxels, _channels = zip(array.shape, array.strides)
    taxels = [n_taxels]
    if len(outer) == 1 and len(layout) == 2:
        step = int(array.strides[-2] or 0)
        taxels = [(layout[0], layout[1] * step), (layout[1], step)]
    channels = [(last - first, array.strides[-1])] if last - first > 1 else []
    axes = [*(outer if batched else outer[1:]), *taxels, *channels]
    size = wp.types.type_size_in_bytes(array.dtype)
    return view(array, [n for n, _ in axes], [step for _, step in axes], array.dtype, first * size)


class Views:
    """The views of a :class:`~tactemu.sensors.sensor.Sensor`."""

    _derived: Mapping[str, Derive]
    _kept: dict[tuple[str, bool], wp.array]
    _status: wp.array | None

    def view(self: Any, name: str, ground_truth: bool = False) -> wp.array:
        """Return one quantity of the last step on the device, ``([n_envs,] layout[, 3])``, over the reading's own
        memory.

        A quantity that is computed from a reading (the ``traction`` of an elastic layer) becomes part of each step once
        you ask for it.

        Raises:
            SceneError: this sensor does not have the quantity, or the scene is not built.
        """
        array, columns = self.array(ground_truth), columns_of(self)
        key = (name, ground_truth and self._truth is not self._measured)
        if key not in self._kept:
            if name in self._derived:
                array, stage = self._derived[name](array, "truth" if key[1] else "measured")
                self._simulation.add_stage(stage)
                columns = {name: slice(None)}
            if name not in columns:
                has = ", ".join([*columns, *self._derived])
                raise SceneError(f"sensor {self.name!r} has no {name!r} to view; it has: {has}")
            layout = self.probes.layout
            self._kept[key] = in_layout(array, columns[name], layout, self._simulation.batched)
        return self._kept[key]

    @property
    def force_array(self) -> wp.array:
        """Measured force on each taxel [N]; a view on the device (:meth:`view`)."""
        return self.view("force")

    @property
    def torque_array(self) -> wp.array:
        """Torque about the link's origin [N m]."""
        return self.view("torque")

    @property
    def depth_array(self) -> wp.array:
        """Depth [m]."""
        return self.view("depth")

    @property
    def displacement_array(self) -> wp.array:
        """Motion of the skin's surface [m]."""
        return self.view("displacement")

    @property
    def pressure_array(self) -> wp.array:
        """Pressure [Pa]."""
        return self.view("pressure")

    @property
    def traction_array(self) -> wp.array:
        """Force per area along the surface [Pa]; an elastic layer computes it in each step once you have asked for
        it."""
        return self.view("traction")

    @property
    def status_array(self: Any) -> wp.array:
        """Bodies whose poses the skin could not use at the last step, uint8, ``([n_envs,] n_bodies)``: 1 where a pose
        was not finite, or its quaternion 0. That environment reads NaN; the others are valid."""
        if self._status is None:
            raise self._unread()
        return self._status if self._simulation.batched else self._status[0]
