"""A skin on a link: the handle through which users read and change a sensor of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, get_args

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.geometry.bodies import Body, find_body
from tactemu.geometry.device_arrays import as_warp_array
from tactemu.geometry.motion import Pose
from tactemu.imperfections import Adjustments, Imperfections
from tactemu.plan.plan import Plan, Stage
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.sensor_model import DepthQuery, Derive, SensorModel
from tactemu.sensors.signs import Convention
from tactemu.sensors.views import Views
from tactemu.transducers.chain import Chain
from tactemu.transducers.transducer import Transducer

MIN_STAGED_BYTES = 2**24
"""Size of a GPU's reading from which on a copy through pinned memory is faster than the driver's own [bytes]."""


class Built(Protocol):
    """The part of a simulation that a sensor's handle uses."""

    batched: bool
    """Do readings have an environment axis?"""
    device: wp.Device
    plan: Plan

    def before_read(self) -> None:
        """Raise the error that the last step found, if any."""
        ...

    def pose(self, body: Body) -> Pose:
        """Return a body's pose and velocities in the world of environment 0."""
        ...

    def add_stage(self, stage: Stage) -> None:
        """Add a stage to the end of each step, and run it now."""
        ...


@dataclass(eq=False)
class Sensor(Views, Adjustments):
    """A skin on a link, as :meth:`tactemu.Scene.add_sensor` returns it. You can read it once the scene is built."""

    name: str
    model: SensorModel
    link: Body
    transducers: tuple[Transducer, ...] = ()
    """The transducers between the model and the electronics, in order."""
    convention: Convention = "skin"
    """The signs of its forces and torques: the model's own, else the scene's."""
    imperfections: Imperfections | None = field(default=None, repr=False)
    """The imperfections of a built scene; their setters change them at run time. ``None`` before the scene is built."""
    _sim: Built | None = field(default=None, repr=False)
    _truth: wp.array | None = field(default=None, repr=False)
    _measured: wp.array | None = field(default=None, repr=False)
    _presented: Callable[[np.ndarray], Any] | None = field(default=None, repr=False)
    _derived: Mapping[str, Derive] = field(default_factory=dict, repr=False)
    _kept: dict[tuple[str, bool], wp.array] = field(default_factory=dict, repr=False)
    _status: wp.array | None = field(default=None, repr=False)
    _staging: wp.array | None = field(default=None, repr=False)

    def clone(self) -> Sensor:
        """Return a separate handle on the same skin, for another simulation."""
        return Sensor(self.name, self.model, self.link, self.transducers, self.convention)

    @cached_property
    def probes(self) -> Probes:
        """Positions, normals and radii of the probes in the link's frame."""
        return self.model.probes(self.name)

    def attach(
        self,
        sim: Built,
        imperfections: Imperfections,
        truth: wp.array,
        measured: wp.array,
        present: Callable[[np.ndarray], Any] | None,
        derived: Mapping[str, Derive],
        status: wp.array,
    ) -> None:
        """Connect the handle to the arrays of a built scene; a later build replaces them."""
        self._sim, self.imperfections, self._truth, self._measured = sim, imperfections, truth, measured
        self._presented, self._derived, self._kept, self._status = present, derived, {}, status
        self._staging = None

    def read(self, out: wp.array | np.ndarray | None = None) -> Any:
        """Return the measured reading of the last step, a NumPy copy of shape ``([n_envs,] [history,] layout[, 3])``.

        Vectors are in the frame of the link. Forces and torques act on the skin, whatever the model: on a taxel whose
        normal is +z a press is a force along -z, and a body that slides to +x drags the skin to +x. A scene or model of
        ``convention="genesis"`` has Genesis's signs instead (:mod:`tactemu.sensors.signs`).

        Args:
            out: memory of the host to copy into, as :meth:`host_array` makes it; the returned array then uses it.

        Raises:
            SceneError: the scene is not built; ``out`` has the wrong shape or type.
            PoseError: on a GPU, a pose of this step was not finite.
        """
        return self._present(self.array(), out)

    def read_ground_truth(self, out: wp.array | np.ndarray | None = None) -> Any:
        """Return the reading of the last step without any imperfection, delay or noise; shaped as :meth:`read`."""
        return self._present(self.array(ground_truth=True), out)

    def host_array(self, ground_truth: bool = False) -> wp.array:
        """Return memory of the host for ``read(out=)``; pinned for a GPU, which then copies at the full speed of its
        bus."""
        array, device = self.array(ground_truth), self._simulation.device
        return wp.zeros(array.shape, dtype=array.dtype, device="cpu", pinned=device.is_cuda)

    def array(self, ground_truth: bool = False) -> wp.array:
        """Return the device array behind a reading, ``(n_envs, [history,] n_taxels, channels)``: nothing is copied
        or waited for, and the next step writes into it."""
        array = self._truth if ground_truth else self._measured
        if array is None:
            raise self._unread()
        return array

    def set(self, option: str, value, envs_idx=None, taxels=None) -> None:
        """Change an imperfection by its option's name (see :class:`~tactemu.imperfections.Adjustments`)."""
        self._required_imperfections.set(option, value, envs_idx, taxels)

    def set_dead(self, taxels, dead: bool = True, value: float | None = None, envs_idx=None) -> None:
        """Make taxels dead, or revive them; a dead taxel reads ``value``, or its last reading where no value is
        given."""
        self._required_imperfections.set_dead(taxels, dead, value, envs_idx)

    @property
    def _required_imperfections(self) -> Imperfections:
        if self.imperfections is None:
            raise SceneError(f"sensor {self.name!r} cannot be changed yet; build the scene first (scene.build())")
        return self.imperfections

    @property
    def on_skin(self) -> bool:
        """Do all forces and torques that the model reports act on the skin?"""
        return self.convention == "skin" or not self.model.has_genesis_signs

    def link_pose(self) -> Pose:
        """Return the pose and velocities of its link as last set, in the world of environment 0."""
        return self.link.pose(0.0) if self._sim is None else self._sim.pose(self.link)

    @cached_property
    def chain(self) -> Chain | None:
        """The chain of its transducers; ``None``: the sensor reads the model's output."""
        where = f"sensor {self.name!r}"
        return Chain(where, self.transducers, self.model.layouts) if self.transducers else None

    @property
    def layouts(self) -> Mapping[str, slice]:
        """The quantities that it reads, each with its channels."""
        return self.model.layouts if self.chain is None else {self.chain.output.quantity: slice(None)}

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names that :meth:`quantity` accepts."""
        return tuple(self.layouts)

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return one quantity of environment 0, taxels in layout order: shape ``(n_taxels,)`` or ``(n_taxels, 3)``.

        Raises:
            SceneError: this model does not offer it.
        """
        array = self.array(ground_truth)
        # a slice saves copying all environments from a GPU; on a CPU numpy() copies nothing
        first = array[:1] if array.size and self._simulation.device.is_cuda else array
        return self.pick(name, self._numpy(first)[:1])[0].copy()

    def pick(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return one quantity of a host copy of :meth:`array`: a view, ``(n_envs, n_taxels)`` or ``(n_envs, n_taxels,
        3)``; of a history the latest entry.

        Raises:
            SceneError: this model does not offer it.
        """
        if name not in self.layouts:
            has = ", ".join(self.quantities) or "none"
            kind = type(self.model).__name__
            raise SceneError(f"sensor {self.name!r} ({kind}) has no {name!r}; it offers: {has}")
        values = values[:, 0] if values.ndim == 4 else values
        values = values[..., self.layouts[name]]
        if name == "touch":
            return values[..., 0] > 0
        return values[..., 0] if values.shape[-1] == 1 else values

    @property
    def _simulation(self) -> Built:
        if self._sim is None:
            raise self._unread()
        return self._sim

    def _unread(self) -> SceneError:
        return SceneError(f"sensor {self.name!r} cannot be read yet; build the scene first (scene.build())")

    def _numpy(self, array: Any) -> np.ndarray:
        self._simulation.before_read()
        return array.numpy()

    def _present(self, array: wp.array, out: wp.array | np.ndarray | None = None):
        sim = self._simulation
        if out is not None:
            values = self._copied(array, out)
        elif sim.device.is_cpu:  # numpy() is a view of the device's own memory
            values = sim.plan.copied(self._numpy(array))
        elif array.capacity < MIN_STAGED_BYTES:
            values = self._numpy(array)
        else:  # through pinned memory: the driver's own copy to new memory is ten times slower
            if self._staging is None:
                self._staging = self.host_array()
            values = sim.plan.copied(self._copied(array, self._staging))
        shape = (*values.shape[:-2], *self.probes.layout, values.shape[-1])
        present = self._presented or (self.model.present if self.chain is None else _plain)
        return present(values.reshape(shape if self._simulation.batched else shape[1:]))

    def _copied(self, array: wp.array, out: wp.array | np.ndarray) -> np.ndarray:
        """Copy a reading into the host memory ``out``, and return it as an array."""
        host = as_warp_array(out, f"read of sensor {self.name!r}: out")
        assert host.device is not None and array.device is not None
        if host.shape != array.shape or host.dtype != array.dtype or not host.device.is_cpu or not host.is_contiguous:
            expected = f"{array.shape} of {array.dtype.__name__}"
            got = f"{host.shape} of {host.dtype.__name__} on {host.device}"
            raise SceneError(
                f"read of sensor {self.name!r}: out must be an array of the host of shape {expected}, in one piece, as "
                f"host_array() makes it; got {got}"
            )
        self._simulation.before_read()
        wp.copy(host, array)
        if array.device.is_cuda:
            wp.synchronize_stream(wp.get_stream(array.device))
        return host.numpy()


def _plain(values: np.ndarray) -> np.ndarray:
    return values[..., 0] if values.shape[-1] == 1 else values


def check_query(sensor: Sensor) -> None:
    """Check the option that selects the depth query.

    Raises:
        SceneError: an option has a wrong value.
    """
    model, known = sensor.model, get_args(DepthQuery)
    if model.contact_depth_query is not None and model.contact_depth_query not in known:
        given = model.contact_depth_query
        raise SceneError(
            f"sensor {sensor.name!r}: contact_depth_query must be one of {', '.join(known)}, got {given!r}"
        )


def sensed_bodies(sensor: Sensor, bodies: Sequence[Body]) -> tuple[Body, ...]:
    """Return the bodies that a sensor senses.

    Raises:
        SceneError: an option names an unknown body, or the sensor's own link.
    """
    model = sensor.model

    def listed(given: Any) -> list[Body]:
        several = isinstance(given, Iterable) and not isinstance(given, str)
        which: list[Any] = list(given) if several else [given]
        return [find_body(bodies, each) for each in which]

    ignored = listed(model.filter_link_idx)
    if model.track_link_idx is None:
        chosen = [body for body in bodies if body is not sensor.link]
    else:
        chosen = listed(model.track_link_idx)
        if sensor.link in chosen:
            raise SceneError(f"sensor {sensor.name!r}: track_link_idx names its own link {sensor.link.name!r}")
    return tuple(body for body in chosen if body.shape is not None and body not in ignored)
