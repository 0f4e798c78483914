"""A skin on a link: the handle through which users read and change a sensor of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.errors import SceneError
from tactemu.base.keywords import takes_words
from tactemu.base.words import GENESIS
from tactemu.geometry.bodies import Body, find_body
from tactemu.geometry.device_arrays import as_warp_array
from tactemu.geometry.motion import Pose
from tactemu.imperfections import Adjustments, Imperfections
from tactemu.imperfections.adjustments import Chosen
from tactemu.plan.array_types import WarpArray
from tactemu.plan.plan import Plan, Stage
from tactemu.sensors.arrays import SensorArrays, pick
from tactemu.sensors.load_match import LoadMatch
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.sensor_model import Derive, R, SensorModel
from tactemu.sensors.signs import Convention
from tactemu.transducers.chain import Chain
from tactemu.transducers.transducer import Transducer

MIN_STAGED_BYTES = 2**24
"""Size of a GPU's reading from which on a copy through pinned memory is faster than the driver's own [bytes]."""


class Built(Protocol):
    """The part of a simulation that a sensor's handle uses."""

    bodies: tuple[Body, ...]
    batched: bool
    """Do readings have an environment axis?"""
    device: wp.Device
    plan: Plan

    def _before_read(self) -> None:
        """Raise the error that the last step found, if any."""
        ...

    def pose(self, body: Body) -> Pose:
        """Return a body's pose and velocities in the world of environment 0."""
        ...

    def _add_stage(self, stage: Stage) -> None:
        """Add a stage to the end of each step, and run it now."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Outputs:
    """The arrays that a sensor's stages write in a built scene, and what presents them."""

    truth: wp.array
    measured: wp.array
    present: Callable[[np.ndarray], Any] | None
    """A function used instead of the model's own."""
    derived: Mapping[str, Derive]
    bad_poses: wp.array
    contacts: Callable[[], tuple[wp.array, Stage]]
    sensed: tuple[Body, ...]
    """The bodies that the sensor senses."""


@dataclass(eq=False)
class Sensor(Adjustments, Generic[R]):
    """A skin on a link, as :meth:`tactemu.Scene.add_sensor` returns it. You can read it once the scene is built."""

    name: str
    model: SensorModel[Any]
    link: Body
    transducers: tuple[Transducer, ...] = ()
    """The transducers between the model and the electronics, in order."""
    convention: Convention = "skin"
    """The signs of its forces and torques: the model's own, else the scene's."""
    imperfections: Imperfections | None = field(default=None, repr=False)
    """The imperfections of a built scene; their setters change them at run time. ``None`` before the scene is built."""
    _load: LoadMatch | None = field(default=None, repr=False)
    """The load that an engine sets, which the forces of its readings then sum up to; set before the scene is built."""
    _sim: Built | None = field(default=None, repr=False)
    _outputs: Outputs | None = field(default=None, repr=False)
    _arrays: dict[bool, SensorArrays] = field(default_factory=dict, repr=False)
    _flags: WarpArray | None = field(default=None, repr=False)
    _staging: wp.array | None = field(default=None, repr=False)
    _views: dict[tuple[str, bool], np.ndarray] = field(default_factory=dict, repr=False)
    """Views of the quantities that were read on a CPU, whose memory the host shares, by name and branch."""

    def _clone(self) -> Sensor[R]:
        """Return a separate handle on the same skin, for another simulation."""
        clone: Sensor[R] = Sensor(self.name, self.model, self.link, self.transducers, self.convention)
        clone.names = self.names
        return clone

    @cached_property
    def _probes(self) -> Probes:
        """Positions, normals and radii of the probes in the link's frame."""
        return self.model.probes(self.name)

    def _attach(self, sim: Built, imperfections: Imperfections, outputs: Outputs) -> None:
        """Connect the handle to the arrays of a built scene; a later build replaces them."""
        self._sim, self.imperfections, self._outputs = sim, imperfections, outputs
        self._arrays, self._flags, self._staging, self._views = {}, None, None, {}

    # -- the skin ---------------------------------------------------------------------------------------------------

    @property
    def layout(self) -> tuple[int, ...]:
        """Shape of the taxels, ``(n,)`` or ``(rows, cols)``."""
        return self._probes.layout

    @property
    def n_taxels(self) -> int:
        """Number of taxels, fillers included."""
        return self._probes.n

    @property
    def positions(self) -> NDArray[np.floating]:
        """Positions of the taxels in the link's frame [m], shape ``(*layout, 3)``."""
        return self._probes.positions.reshape(*self.layout, 3)

    @property
    def normals(self) -> NDArray[np.floating]:
        """Unit normals of the taxels, out of the skin, in the link's frame, shape ``(*layout, 3)``."""
        return self._probes.normals.reshape(*self.layout, 3)

    @property
    def radii(self) -> NDArray[np.floating]:
        """Sensing radii of the taxels [m], shape ``layout``; 0 marks a filler."""
        return self._probes.radii.reshape(self.layout)

    @property
    def unit(self) -> str:
        """SI unit of the reading; of a reading with several fields theirs, in order, separated by commas. It is empty
        for touch."""
        if self._chain is not None:
            return self._chain.output.unit
        return self.model.unit if self.model.reading_unit is None else self.model.reading_unit

    # -- readings ---------------------------------------------------------------------------------------------------

    def read(self, out: WarpArray | NDArray[Any] | None = None) -> R:
        """Return the measured reading of the last step, a copy in NumPy arrays: one array, or a named tuple of arrays
        if the model gives several fields (:class:`~tactemu.ForceTorque`, :class:`~tactemu.LayerReading`).

        Shapes are ``([n_envs,] [history,] layout)``, of vectors ``([n_envs,] [history,] layout, 3)``. Units are SI
        (:attr:`unit`), vectors are in the link's frame. With transducers the reading is one array, the signal of the
        last.

        Vectors are in the frame of the link. Forces and torques act on the skin, whatever the model: on a taxel whose
        normal is +z a press is a force along -z, and a body that slides to +x drags the skin to +x. A scene or model of
        ``convention="genesis"`` has Genesis's signs instead (:mod:`tactemu.sensors.signs`).

        Args:
            out: memory of the host to copy into, as :meth:`host_array` makes it; the returned arrays then use it.

        Raises:
            SceneError: the scene is not built; ``out`` has the wrong shape or type.
            PoseError: on a GPU, a pose of this step was not finite.
        """
        return self._present(self._built.measured, out)

    def read_ground_truth(self, out: WarpArray | NDArray[Any] | None = None) -> R:
        """Return the reading of the last step without any imperfection, delay or noise; shaped as :meth:`read`."""
        return self._present(self._built.truth, out)

    def host_array(self, ground_truth: bool = False) -> WarpArray:
        """Return memory of the host for ``read(out=)``; pinned for a GPU, which then copies at the full speed of its
        bus."""
        array, device = reading_array(self, ground_truth), self._simulation.device
        return wp.zeros(array.shape, dtype=array.dtype, device="cpu", pinned=device.is_cuda)

    @property
    def arrays(self) -> SensorArrays:
        """The fields of :meth:`read` as arrays on the device: ``skin.arrays.force``. They copy nothing and do not
        wait; the next step writes into them."""
        return self._arrays_of(False)

    @property
    def ground_truth_arrays(self) -> SensorArrays:
        """The fields of :meth:`read_ground_truth` as arrays on the device, as :attr:`arrays` are those of
        :meth:`read`."""
        return self._arrays_of(True)

    def touching(self, body: Body | str | int | None = None) -> NDArray[np.bool_]:
        """Return True where a body touched the skin at the last step, shape ``([n_envs])``.

        It touches where a taxel is in it: deeper than 0 m for a model of depth or springs, at the taxel's own point for
        the others. It holds for the true skin, without imperfections. An environment in which the body's pose was not
        finite returns True; on a GPU :meth:`Simulation.check` names it. ``arrays.contacts`` has the flags of all bodies
        on the device. Each step computes them from the first call on.

        Args:
            body: the body, its name or its index; ``None``: any that the sensor senses.

        Raises:
            SceneError: the scene is not built, or the sensor does not sense the body.
            PoseError: on a GPU, a pose of this step was not finite.
        """
        sensed = self._built.sensed
        if body is not None:
            chosen = find_body(self._simulation.bodies, body)
            if chosen not in sensed:
                names = ", ".join(each.name for each in sensed) or "no body"
                raise SceneError(f"sensor {self.name!r} does not sense body {chosen.name!r}; it senses: {names}")
            sensed = (chosen,)
        flags = self._numpy(self._contact_flags())[:, [each.index for each in sensed]]
        touches: NDArray[np.bool_] = np.logical_or.reduce(flags != 0, axis=1)
        return touches if self._simulation.batched else touches[0, ...]

    def link_pose(self) -> Pose:
        """Return the pose and velocities of its link as last set, in the world of environment 0."""
        return self.link.pose(0.0) if self._sim is None else self._sim.pose(self.link)

    # -- readings of a device ---------------------------------------------------------------------------------------

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names that :meth:`quantity` accepts."""
        return tuple(self._layouts)

    def quantity(self, name: str, ground_truth: bool = False) -> NDArray[Any]:
        """Return one quantity of environment 0, taxels in layout order: shape ``(n_taxels,)`` or ``(n_taxels, 3)``.

        Raises:
            SceneError: this model does not offer it.
        """
        self._simulation._before_read()
        view = self._views.get((name, ground_truth))
        if view is None:
            view = self._view(name, ground_truth)
        return view > 0 if name == "touch" else view.copy()

    def _view(self, name: str, ground_truth: bool) -> np.ndarray:
        """Return one quantity of environment 0; on a CPU a view that shows every later step, too."""
        array, is_cpu = reading_array(self, ground_truth), self._simulation.device.is_cpu
        # a slice saves copying all environments from a GPU; on a CPU numpy() copies nothing
        view = pick(self, name, (array if is_cpu or not array.size else array[:1]).numpy())[0]
        if is_cpu:
            self._views[name, ground_truth] = view
        return view

    # -- imperfections ----------------------------------------------------------------------------------------------

    @takes_words
    def set(self, option: str, value: Any, envs: Chosen | None = None, taxels: Chosen | None = None) -> None:
        """Change an imperfection by its option's name (see :class:`~tactemu.imperfections.Adjustments`)."""
        option = GENESIS.get(option, option) if self.names == "genesis" else option
        self._required_imperfections.set(option, value, envs, taxels)

    @takes_words
    def set_dead(
        self, taxels: int | Chosen, dead: bool = True, value: float | None = None, envs: Chosen | None = None
    ) -> None:
        """Make taxels dead, or revive them; a dead taxel reads ``value``, or its last reading where no value is
        given."""
        self._required_imperfections.set_dead(taxels, dead, value, envs)

    @property
    def _required_imperfections(self) -> Imperfections:
        if self.imperfections is None:
            raise SceneError(f"sensor {self.name!r} cannot be changed yet; build the scene first (scene.build())")
        return self.imperfections

    # -- the parts of the above -------------------------------------------------------------------------------------
    @property
    def on_skin(self) -> bool:
        """Do all forces and torques that the model reports act on the skin?"""
        return self.convention == "skin" or not self.model.has_genesis_signs

    @cached_property
    def _chain(self) -> Chain | None:
        """The chain of its transducers; ``None``: the sensor reads the model's output."""
        where = f"sensor {self.name!r}"
        return Chain(where, self.transducers, self.model.layouts) if self.transducers else None

    @property
    def _layouts(self) -> Mapping[str, slice]:
        """The quantities that it reads, each with its channels."""
        return self.model.layouts if self._chain is None else {self._chain.output.quantity: slice(None)}

    @property
    def _built(self) -> Outputs:
        if self._outputs is None:
            raise self._unread()
        return self._outputs

    @property
    def _simulation(self) -> Built:
        if self._sim is None:
            raise self._unread()
        return self._sim

    def _unread(self) -> SceneError:
        return SceneError(f"sensor {self.name!r} cannot be read yet; build the scene first (scene.build())")

    def _arrays_of(self, ground_truth: bool) -> SensorArrays:
        outputs = self._built
        branch = ground_truth and outputs.truth is not outputs.measured
        if branch not in self._arrays:
            self._arrays[branch] = SensorArrays(self, branch)
        return self._arrays[branch]

    def _contact_flags(self) -> WarpArray:
        """Return the contact flags of all bodies, ``(n_envs, n_bodies)``; the first call adds their stage."""
        if self._flags is None:
            self._flags, stage = self._built.contacts()
            self._simulation._add_stage(stage)
        return self._flags

    def _numpy(self, array: Any) -> np.ndarray:
        self._simulation._before_read()
        return array.numpy()

    def _present(self, array: wp.array, out: wp.array | np.ndarray | None = None) -> Any:
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
        shape = (*values.shape[:-2], *self._probes.layout, values.shape[-1])
        present = self._built.present or (self.model.present if self._chain is None else _plain)
        return present(values.reshape(shape if sim.batched else shape[1:]))

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
        self._simulation._before_read()
        wp.copy(host, array)
        if array.device.is_cuda:
            wp.synchronize_stream(wp.get_stream(array.device))
        return host.numpy()


def reading_array(sensor: Sensor, ground_truth: bool = False) -> wp.array:
    """Return the device array behind a reading, ``(n_envs, [history,] n_taxels, channels)``: nothing is copied or
    waited for, and the next step writes into it.

    Raises:
        SceneError: the scene is not built.
    """
    outputs = sensor._built
    return outputs.truth if ground_truth else outputs.measured


def _plain(values: np.ndarray) -> np.ndarray:
    return values[..., 0] if values.shape[-1] == 1 else values


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

    ignored = listed(model.ignore)
    if model.sense is None:
        chosen = [body for body in bodies if body is not sensor.link]
    else:
        chosen = listed(model.sense)
        if sensor.link in chosen:
            raise SceneError(f"sensor {sensor.name!r}: sense names its own link {sensor.link.name!r}")
    return tuple(body for body in chosen if body.shape is not None and body not in ignored)
