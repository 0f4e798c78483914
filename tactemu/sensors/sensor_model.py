"""The base class of all tactile sensor models, and how to write one.

A model is a dataclass of options in one file, derived from :class:`SensorModel`::

    @dataclass(frozen=True, kw_only=True, eq=False)
    class MyTaxel(SensorModel[NDArray[np.floating]]):         # the type of its reading
        stiffness: float = 1.0
        level = 2
        channels = ("force",)                                 # three numbers per taxel
        layouts = {"force": slice(0, 3)}                      # quantities for devices
        unit = "N"

        def compile(self, site: Site) -> Compiled:
            raw = site.zeros()                                # (n_envs, n_taxels, channels), site.context.real
            kernel = my_kernel(site.context.real, site.table.kinds)
            inputs = [site.sensed, site.positions, self.stiffness]
            launch = site.context.record(kernel, raw.shape[:2], inputs, [raw])
            stage = Stage(name=f"{site.name}: my taxel", reason="MyTaxel reads force", launch=launch)
            return Compiled(truth=raw, raw=raw, stages=[stage])

A model of your own imports these names from :mod:`tactemu.models`, and scene files name its file and class. One line
in :mod:`tactemu.sensors.models` registers a model of this package for scene files, ``tactemu tune``, the benches and
``docs/sensors.md``; ``docs/adding-a-sensor-model.md`` shows all steps. A model's ``compile`` gets a :class:`Site`:

* ``site.view``: poses ``(n_envs, n_bodies)`` of all bodies in the link's frame, and twists if
  :meth:`SensorModel.velocity_reason` returns one (:class:`tactemu.sensors.poses.LinkView`).
* ``site.sensed``: the bodies to sense as kernels take them: their shapes, poses and indices
  (:func:`tactemu.sensors.sensed.sensed_type`); ``site.target_bodies`` are the same on the host.
* ``site.table``: the shapes of these bodies. In a kernel factory ``f = shape_functions(real, kinds)`` gives
  ``f.distance_in_link(sensed.shapes, b, sensed.pose[e, b], r) -> (signed distance, normal)`` for any kind of shape
  (:mod:`tactemu.geometry.shapes.distance`); ``site.own_table`` is the table of the link's own shape (row
  ``site.link.index``, pose the identity).
* ``site.positions``, ``site.normals``, ``site.radii``: the probes on the device; ``site.probes`` the same on the host.
* ``site.gain``, ``site.radius``: per-environment arrays ``(n_envs, n_taxels)`` of the measured branch, or ``None``
  where no imperfection needs them. If both are ``None`` the measured branch starts as the truth: return the same array
  for both, it is never written to.

* ``site.zeros()``, and ``zeros``, ``full`` and ``array`` of ``site.context``: arrays that last from step to step. They
  are the saved state of a simulation; scratch and constants need not be made by them.

``site.context.record`` passes the kernel one more argument, its first: the environment of its first thread. After ``e,
i = wp.tid()`` the kernel adds it, ``e += first_env``, so that threads can share a batch; a plain
:func:`tactemu.plan.launches.record` does not pass it, and one thread runs the launch.

A kernel comes from a cached factory per float type, with ``@warp_kernel`` of :mod:`tactemu.base.kernels`, in a file
*without* ``from __future__ import annotations``. A NaN pose must come out as NaN, not as 'no contact':
``wp.max(0, NaN)`` is 0.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.option_groups import Options
from tactemu.base.units import Length
from tactemu.geometry.bodies import Body
from tactemu.imperfections import ElectronicsOptions, ImperfectionOptions
from tactemu.imperfections.info import Channels
from tactemu.imperfections.options import Law
from tactemu.plan.array_types import WarpArray
from tactemu.plan.plan import Context, Dtype, Stage
from tactemu.sensors.drawing import DrawOptions
from tactemu.sensors.point_cloud import PointCloud
from tactemu.sensors.poses import LinkView
from tactemu.sensors.probe_layout import Probes, make_probes
from tactemu.sensors.sensed import sensed_type
from tactemu.sensors.shape_table import ShapeTable, ShapeTables
from tactemu.sensors.signs import Convention

if TYPE_CHECKING:  # a model reads anything unless it says SensorModel[ForceTorque]
    from typing_extensions import TypeVar

    R = TypeVar("R", covariant=True, default=Any)
else:
    from typing import TypeVar

    R = TypeVar("R", covariant=True)

DepthQuery = Literal["sdf", "raycast", "band", "voxel", "ray"]
WhichBody = Body | str | int
Derive = Callable[[WarpArray, str], tuple[WarpArray, Stage]]
"""A function of a reading and its branch, ``truth`` or ``measured``, that returns a derived array and the stage that
fills it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Site:
    """The place where a model is compiled: everything that it may use of the scene. See the module's docstring."""

    name: str
    model: SensorModel[Any]
    context: Context
    link: Body
    probes: Probes
    n_channels: int
    view: LinkView
    target_bodies: tuple[Body, ...]
    targets: WarpArray
    shapes: ShapeTables
    clouds: dict[tuple[int, int], PointCloud]
    """Points on bodies, by body and number: sensors that ask for the same number on the same body share them."""
    positions: WarpArray
    normals: WarpArray
    radii: WarpArray
    on_skin: bool = True
    """Do all forces and torques of the reading act on the skin (:mod:`tactemu.sensors.signs`)? Only a model that has
    Genesis's signs needs to look."""
    gain: WarpArray | None = None
    radius: WarpArray | None = None

    @cached_property
    def table(self) -> ShapeTable:
        """The shapes of the bodies to sense."""
        model = self.model
        return self.shapes.table(self.target_bodies, model.depth_query, model.voxel_size)

    @cached_property
    def sensed(self) -> Any:
        """The bodies to sense, as kernels take them."""
        sensed = sensed_type(self.context.real)()
        sensed.shapes, sensed.targets = self.table.struct, self.targets
        sensed.pose, sensed.near = self.view.pose, self.view.near
        return sensed

    @cached_property
    def own_table(self) -> ShapeTable:
        """The shape of the sensor's own link."""
        return self.shapes.table((self.link,))

    @property
    def vec3(self) -> Any:
        """The context's vector type."""
        return wp.types.vector(3, self.context.real)

    def zeros(self, channels: int | None = None) -> WarpArray:
        """Return a new array ``(n_envs, n_taxels, channels)`` of the context's type."""
        shape = (self.context.n_envs, self.probes.n, channels or self.n_channels)
        return self.context.zeros(shape, self.context.real)

    @property
    def along_normal(self) -> bool:
        """Is depth measured along the taxels' normals?"""
        return self.model.depth_query == "ray"

    @property
    def separate(self) -> bool:
        """Does the measured branch differ from the truth before any imperfection (gain, noised radius)?"""
        return self.gain is not None or self.radius is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class TouchPoints:
    """The points of a skin at which bodies touch it, in the link's frame."""

    positions: np.ndarray
    """Positions [m], ``(n, 3)``."""
    normals: np.ndarray
    """Unit normals, ``(n, 3)``."""
    radii: np.ndarray
    """Distance below which a body touches each [m], ``(n,)``; negative for a point that is no skin."""
    reach: np.ndarray | None
    """Distance behind each point at which a ray along its normal begins [m], ``(n,)``; ``None``: the distance is that
    to the nearest surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Compiled:
    """The result of a model's :meth:`SensorModel.compile`."""

    truth: WarpArray
    """Ground truth, ``(n_envs, n_taxels, channels)``."""
    raw: WarpArray
    """The measured branch before imperfections; the same array as ``truth`` unless ``site.separate``."""
    stages: list[Stage]
    finish: Callable[[WarpArray, str], tuple[WarpArray, list[Stage]]] | None = None
    """A function that is applied to each branch, ``finish(array, "truth" | "measured")``, after the imperfections and
    before the delay."""
    present: Callable[[NDArray[Any]], Any] | None = None
    """A function used instead of :meth:`SensorModel.present` where presenting needs the compiled arrays."""
    derived: Mapping[str, Derive] = field(default_factory=dict)
    """Quantities derived from a reading, by name, of which users may ask for arrays on the device
    (:attr:`Sensor.arrays`)."""
    touch_points: Callable[[], Sequence[TouchPoints]] | None = None
    """A function that returns the points where bodies touch the skin; ``None``: they touch its probes."""


@dataclass(frozen=True)
class Setting:
    """A sensor model with the options that decide its cost and its accuracy."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    dtype: Dtype = "float32"
    model: str = ""
    """The name of the model, as in scene files; empty in the settings that a model itself offers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorModel(Options, Generic[R]):
    """Options that all tactile sensors share. Positions, normals and readings are in the frame of the link.

    The type parameter is that of a reading: an array, or a named tuple of arrays if it has several fields.

    They are frozen: ``dataclasses.replace(model, stiffness=2.0)`` makes another model, and :meth:`Sensor.set` changes
    imperfections at run time. Scene files have the options of the three groups beside the model's own.
    """

    positions: Sequence | np.ndarray = ((0.0, 0.0, 0.0),)
    """Probe positions [m], ``(n, 3)``, or ``(rows, cols, 3)`` for a grid; readings have the same layout."""
    normals: Sequence | np.ndarray = (0.0, 0.0, 1.0)
    """Directions out of the skin: one, or one per probe; of any length."""
    radius: float | Sequence | np.ndarray = 0.01
    """Sensing radius [m]: one, or one per probe. 0 marks a filler, which reads 0 and has no effect."""
    position: Sequence[float] = (0.0, 0.0, 0.0)
    """Shift of the probes in the link's frame [m]."""
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the probes in the link's frame (w, x, y, z), before the shift; of any length."""
    sense: WhichBody | Sequence[WhichBody] | None = None
    """The bodies to sense, by index, name or body; ``None``: all but the sensor's own."""
    ignore: WhichBody | Sequence[WhichBody] = ()
    """Bodies to ignore."""
    depth_query: DepthQuery | None = None
    """The query that finds depth. ``sdf`` (default) and ``raycast``: exact distance to the nearest surface. ``band``:
    within 2 µm of it, from a grid beside the surface of meshes. ``voxel``: a grid of distances with cells of
    ``voxel_size``. ``ray``: along the taxel's normal, exact at any depth."""
    voxel_size: Length | None = None
    """Cell size of the voxel query [m], ``None``: the shape's largest extent / 64; of the band, ``None``: / 96."""
    ray_reach: Length | None = None
    """Depth of the skin that the ray query covers [m]; ``None``: to the far side of the sensor's own link."""
    convention: Convention | None = None
    """Signs of forces and torques. ``skin``: all act on the skin, so that a press is a force along minus the normal.
    ``genesis``: those of Genesis's sensor of this name; a model that Genesis lacks keeps ``skin``. ``None``: the
    scene's convention, ``skin`` by default."""
    imperfections: ImperfectionOptions = ImperfectionOptions()
    """Imperfections of the skin: gains, crosstalk, hysteresis, creep, dead taxels."""
    electronics: ElectronicsOptions = ElectronicsOptions()
    """Imperfections of the read-out: scan, temperature, drift, noise, saturation, resolution, delay."""
    adjustable: Sequence[Law] = ()
    """Options of these two groups that are built although they are zero, with a number per column, so that their
    setters can switch them on while the scene runs; ``dead`` is for :meth:`Sensor.set_dead`."""
    draw: DrawOptions = DrawOptions()
    """Options of how viewers draw the sensor; they change no reading."""

    # These attributes describe a model. Scene files, `tactemu tune`, the benches and docs/sensors.md read them here.
    level: ClassVar[int]
    """Level of fidelity, 0 (a touch flag) to 4 (a solved contact)."""
    work: ClassVar[float] = 1.0
    """Approximate cost of a taxel on a CPU, relative to a depth probe that touches a ball (about 5 ns)."""
    channels: ClassVar[tuple[Channels, ...]] = ("scalar",)
    """The channels of a taxel, in order: ``scalar`` is one number, ``force``, ``torque``, ``displacement`` three
    each."""
    unit: ClassVar[str] = ""
    """SI unit in which noise, resolution and the other imperfections are given."""
    reading_unit: ClassVar[str | None] = None
    """SI units of the reading's fields, where they are not ``unit``."""
    gain_inside: ClassVar[bool] = True
    """Does the model apply ``site.gain`` itself? If not, the gain multiplies the reading after hysteresis."""
    layouts: ClassVar[dict[str, slice]] = {}
    """Quantities that the model offers (see :data:`firmware_protocols.device.Quantity`), each with its channels."""
    has_genesis_signs: ClassVar[bool] = False
    """Does it reverse parts of its reading where ``site.on_skin`` is false? If not, all always acts on the skin."""
    more_fields: ClassVar[dict[str, slice]] = {}
    """Fields of the reading that are no quantity of a device, each with its channels."""
    load_fields: ClassVar[tuple[str, ...]] = ()
    """Fields of the reading that grow with the load of a contact, if its ``force`` is that of contacts: an engine that
    knows the load scales them. Empty: the readings are none of a load."""
    senses_within_radius: ClassVar[bool] = False
    """Do its probes sense bodies nearer than their radius? Sunk by that radius, they measure from the first contact."""
    strengths: ClassVar[tuple[str, ...]] = ()
    """Options that scale every channel of the reading: a fitted gain is written into them."""
    material: ClassVar[tuple[str, ...]] = ()
    """Options that state the material of the skin. Readings are then physical, and no gain is fitted."""
    examples: ClassVar[Mapping[str, Mapping[str, Any]]] = {"": {"radius": 0.002}}
    """The examples that benches and tests run on probes 2.5 mm apart: words behind the class's name, and options."""
    tried: ClassVar[Sequence[Setting]] = (Setting("defaults"),)
    """The settings that ``tactemu tune`` tries, the cheapest first; see :meth:`trials` for one that depends on the
    quantity."""
    valid: ClassVar[str] = ""
    """The situations in which its readings are meaningful, and those in which they are not."""
    source: ClassVar[str] = ""
    """The origin of its formula. The formula itself is in the docstring of the module."""

    @classmethod
    def trials(cls, quantity: str) -> Sequence[Setting]:
        """Return the settings that ``tactemu tune`` tries for a device that senses ``quantity``."""
        return cls.tried

    @classmethod
    def finest(cls, side: int) -> Setting | None:
        """Return the most accurate setting for a skin of ``side`` taxels along its longer side, at any cost, as a
        reference for other models; ``None``: the model is no reference."""
        return None

    @abstractmethod
    def compile(self, site: Site) -> Compiled:
        """Allocate the arrays, and return them with the stages. Called once per build."""

    def velocity_reason(self) -> str | None:
        """Return the reason why the model needs relative velocities; ``None``: it does not need them."""
        return None

    def validate(self, probes: Probes) -> None:
        """Check options against each other."""

    @property
    def relaxes(self) -> bool:
        """Does the model itself remember its load over time? Then no imperfection and no transducer may do so."""
        return False

    def present(self, values: NDArray[Any]) -> R:
        """Turn a copy of the channels, ``(..., n_channels)``, into the result of ``read()``; views of it suffice."""
        return cast(R, values[..., 0] if self.n_channels == 1 else values)

    @property
    def n_channels(self) -> int:
        """Number of channel values of one taxel."""
        return sum(1 if kind == "scalar" else 3 for kind in self.channels)

    def probes(self, sensor: str) -> Probes:
        """Return the probes that the options describe, checked; ``sensor`` is the name for messages."""
        return make_probes(
            self.positions,
            self.normals,
            self.radius,
            self.position,
            self.quaternion,
            sensor,
        )


def upload_probes(probes: Probes, context: Context) -> dict[str, wp.array]:
    """Return positions, normals and radii on the device, by their names in :class:`Site`."""
    vec3 = wp.types.vector(3, context.real)
    device = context.device
    return {
        "positions": wp.array(probes.positions, dtype=vec3, device=device),
        "normals": wp.array(probes.normals, dtype=vec3, device=device),
        "radii": wp.array(probes.radii, dtype=context.real, device=device),
    }
