"""The arrays of a sensor on the device, by the names of its reading's fields.

They copy nothing and do not wait, and the next step writes into them. One conversion by
``torch.from_dlpack(skin.arrays.force)``, or that of CuPy, NumPy or (of ``packed``) JAX, stays valid for all steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError, no_such
from tactemu.geometry.device_arrays import view
from tactemu.plan.array_types import WarpArray


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


def fields_of(sensor: Any) -> dict[str, slice]:
    """Return the fields of a sensor's reading that are channels of their own, by name."""
    if sensor._chain is not None:
        return dict(sensor._layouts)
    found: dict[str, slice] = {}
    for name, columns in (sensor.model.layouts | sensor.model.more_fields).items():
        if columns not in found.values():  # the touch of a layer is its pressure
            found[name] = columns
    return found


def _makers(sensor: Any, is_truth: bool) -> dict[str, Callable[[], WarpArray]]:
    """Return the functions that make the arrays of a sensor's reading, by field."""
    outputs, batched = sensor._built, sensor._simulation.batched
    reading = outputs.truth if is_truth else outputs.measured

    def shaped(array: wp.array, columns: slice) -> WarpArray:
        return in_layout(array, columns, sensor.layout, batched)

    def derived(name: str) -> WarpArray:
        array, stage = outputs.derived[name](reading, "truth" if is_truth else "measured")
        sensor._simulation._add_stage(stage)
        return shaped(array, slice(None))

    def by_body(flags: wp.array) -> WarpArray:
        return flags if batched else cast(WarpArray, flags[0])

    return {
        **{name: partial(shaped, reading, columns) for name, columns in fields_of(sensor).items()},
        **{name: partial(derived, name) for name in outputs.derived},
        "packed": partial(shaped, reading, slice(None)),
        "contacts": lambda: by_body(sensor._contact_flags()),
        "bad_poses": lambda: by_body(outputs.bad_poses),
    }


class SensorArrays:
    """The arrays on the device of one sensor's reading, measured or true, as :attr:`Sensor.arrays` returns them.

    A field has the name, unit and shape that it has in ``read()``: ``([n_envs,] layout)``, of vectors ``([n_envs,]
    layout, 3)``; with a history ``([n_envs,] history, n_taxels[, 3])``. Its type is a Warp array of the kernels' float
    type, and what has ``from_dlpack`` reads it without a copy. A field that this sensor does not have raises
    :class:`~tactemu.base.errors.SceneError`, which names those that it has; ``dir()`` lists them.
    """

    force: WarpArray
    """Force on each taxel [N]; a vector."""
    torque: WarpArray
    """Torque of each taxel about the link's origin [N m]; a vector."""
    depth: WarpArray
    """Depth [m]."""
    displacement: WarpArray
    """Displacement of the skin's surface, or of its markers [m]; a vector."""
    pressure: WarpArray
    """Pressure [Pa]."""
    traction: WarpArray
    """Force per area along the surface [Pa]; a vector. An elastic layer computes it in each step once you have asked
    for it."""
    touch: WarpArray
    """1 where a taxel touches, else 0; NaN where a pose was not finite."""
    slip: WarpArray
    """Slip state, 0: free, 1: sticks, 2: slips."""
    residual: WarpArray
    """Relative residual of the solvers."""
    field: WarpArray
    """Magnetic flux density [T], of a transducer; a vector."""
    resistance: WarpArray
    """Resistance [Ohm], of a transducer."""
    capacitance: WarpArray
    """Capacitance [F], of a transducer."""
    packed: WarpArray
    """All channels of a taxel side by side, in the order of ``skin.model.layouts``, ``([n_envs,] layout[, channels])``:
    in one piece, for a library such as JAX that takes no strided array."""
    contacts: WarpArray
    """Contact flags of the bodies, uint8, ``([n_envs,] n_bodies)``: see :meth:`Sensor.touching`. Each step computes
    them once you have asked for them."""
    bad_poses: WarpArray
    """Poses that the skin could not use at the last step, uint8, ``([n_envs,] n_bodies)``: 1 where a pose was not
    finite, or its quaternion 0. That environment reads NaN; the others are valid."""

    def __init__(self, sensor: Any, is_truth: bool):
        self._sensor, self._makers = sensor.name, _makers(sensor, is_truth)

    def __dir__(self) -> list[str]:
        return [*self._makers]

    if not TYPE_CHECKING:  # else a checker would take any name

        def __getattr__(self, name: str) -> Any:
            """Return the array of a field; it is made once."""
            if name.startswith("_"):
                raise AttributeError(name)
            if name not in self._makers:
                raise SceneError(f"sensor {self._sensor!r} has {no_such('array', name, self._makers)}")
            made = vars(self)[name] = self._makers[name]()
            return made


def pick(sensor: Any, name: str, values: np.ndarray) -> np.ndarray:
    """Return one quantity of a host copy of a reading: a view, ``(n_envs, n_taxels)`` or ``(n_envs, n_taxels, 3)``.

    Of a history it is that of the latest entry; of ``touch`` it is above 0 where there is contact. The copy is one of
    :func:`tactemu.sensors.sensor.reading_array`.

    Raises:
        SceneError: this sensor does not offer it.
    """
    layouts = sensor._layouts
    if name not in layouts:
        has, kind = ", ".join(layouts) or "none", type(sensor.model).__name__
        raise SceneError(f"sensor {sensor.name!r} ({kind}) has no {name!r}; it offers: {has}")
    values = (values[:, 0] if values.ndim == 4 else values)[..., layouts[name]]
    return values[..., 0] if values.shape[-1] == 1 or name == "touch" else values
