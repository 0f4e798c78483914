"""A scene: bodies, and skins on them. Building it compiles the plan of the computation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from tactemu.base.errors import SceneError, shown
from tactemu.base.keywords import takes_words
from tactemu.base.options import choice, number
from tactemu.base.units import DEFAULT_STEP_S, StepSeconds
from tactemu.base.words import Names
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body, WorldMotion, find_body
from tactemu.geometry.shapes.registry import SHAPES
from tactemu.geometry.shapes.shape import Shape
from tactemu.geometry.shapes.texture import TEXTURES, Texture
from tactemu.sensors.signs import Convention, require_on_skin

if TYPE_CHECKING:
    from tactemu.geometry.motion import Motion
    from tactemu.plan.plan import Dtype
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.sensor_model import R, SensorModel
    from tactemu.sensors.simulation import Simulation
    from tactemu.sensors.split import SplitSimulation
    from tactemu.transducers.transducer import Transducer


class Scene:
    """The bodies and sensors of a scene, before anything is computed.

    Args:
        dt: time that one step advances [s].
        convention: signs of forces and torques, where a model does not set them: all act on the skin, or those of
            Genesis (:mod:`tactemu.sensors.signs`).
        names: ``genesis``: this scene, its simulations and its sensors also take Genesis's words for our keywords
            (:data:`tactemu.base.words.GENESIS`), and ``add_sensor`` a model's class with its options side by side.

    Raises:
        SceneError: an option is wrong.
    """

    def __init__(self, dt: float = DEFAULT_STEP_S, *, convention: Convention = "skin", names: Names = "tactemu"):
        self.dt: float = number("Scene", "dt", dt, StepSeconds)
        self.convention: Convention = choice("Scene", "convention", convention, Convention)
        self.names: Names = choice("Scene", "names", names, Names)
        self.bodies: list[Body] = []
        self._names: set[str] = set()
        """Names of the bodies."""
        self.sensors: list[Sensor[Any]] = []
        self.posers: list[Callable[[Simulation, Any], None]] = []
        """Functions that pose bodies at each step of the built scene: other simulators. They get the time since its
        reset [s], in a batch the times of all environments, ``(n_envs,)``."""
        self.planners: list[Callable[[Simulation], None]] = []
        """Functions that add stages to a scene when it is built: other simulators on its device."""
        self._built: Simulation | None = None

    @takes_words
    def add_body(
        self,
        shape: Shape | None = None,
        *,
        name: str | None = None,
        fixed: bool = False,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        quaternion: Sequence[float] | None = None,
        order: rotation.Order = "wxyz",
        motion: Motion | WorldMotion | None = None,
        texture: Texture | None = None,
    ) -> Body:
        """Add a rigid body.

        Args:
            shape: its geometry; ``None`` makes a bare frame.
            name: for messages and the plan; default: the shape's name and its index.
            fixed: the body never moves; a motion or :meth:`Simulation.set_pose` on it is an error.
            position: world position at the start [m].
            quaternion: orientation there, (w, x, y, z), of any length > 0; ``None``: not turned.
            order: order of the quaternion's numbers, ``wxyz`` or ``xyzw``.
            motion: a motion of :mod:`tactemu.geometry.motion`, which displaces the body from its start, or an object
                whose ``pose(t_s)`` returns world poses (:class:`tactemu.Pose`). Each environment's begins when that
                is reset; in a batch your own object gets the times of all environments, ``(n_envs,)``.
            texture: heights of its surface above the shape: a map or a spectrum
                (:mod:`tactemu.geometry.shapes.texture`).

        Raises:
            SceneError: an option is wrong, or the name is taken.
        """
        if shape is not None and not isinstance(shape, Shape):
            raise SceneError(f"add_body: expected a shape ({', '.join(SHAPES)}) or None, got {shape!r}")
        if not isinstance(fixed, bool | np.bool_):
            raise SceneError(f"add_body: fixed must be true or false, got {shown(fixed)}")
        index = len(self.bodies)
        kind = type(shape).__name__.lower() if shape is not None else "frame"
        name = name or f"{kind}{index}"
        if name in self._names:
            raise SceneError(f"body {name!r}: there is already a body of this name; choose another name")
        if fixed and motion is not None:
            raise SceneError(f"body {name!r}: it is fixed and has a motion; remove one of the two")
        turn = (1.0, 0.0, 0.0, 0.0) if quaternion is None else rotation.wxyz(quaternion, order, f"body {name!r}")
        xyz, wxyz = np.asarray(position, float), np.asarray(turn, float)
        if xyz.shape != (3,) or not np.isfinite(xyz).all():
            raise SceneError(f"body {name!r}: position must be 3 finite numbers, got {position!r}")
        with np.errstate(over="ignore"):
            length = np.linalg.norm(wxyz)
        if wxyz.shape != (4,) or not np.isfinite(length) or length < 1e-6:
            raise SceneError(f"body {name!r}: quaternion must be 4 numbers (w, x, y, z), not all 0, got {quaternion!r}")
        wxyz = wxyz / length
        x, y, z = map(float, xyz)
        qw, qx, qy, qz = map(float, wxyz)
        if texture is not None and (shape is None or not isinstance(texture, Texture)):
            known = ", ".join(each.__name__ for each in TEXTURES.values())
            raise SceneError(f"body {name!r}: texture must be one of {known}, on a body with a shape, got {texture!r}")
        body = Body(index, name, shape, fixed, (x, y, z), (qw, qx, qy, qz), motion, texture)
        self.bodies.append(body)
        self._names.add(name)
        self._outdate(f"body {name!r} was added after the scene was built")
        return body

    @overload
    def add_sensor(
        self, model: SensorModel[R], *, link: Body | str | int, name: str | None = None, transducers: tuple[()] = ()
    ) -> Sensor[R]: ...

    @overload
    def add_sensor(
        self,
        model: SensorModel[Any],
        *,
        link: Body | str | int,
        name: str | None = None,
        transducers: Sequence[Transducer],
    ) -> Sensor[NDArray[np.floating]]: ...

    @takes_words
    def add_sensor(
        self,
        model: SensorModel[Any],
        *,
        link: Body | str | int,
        name: str | None = None,
        transducers: Sequence[Transducer] = (),
    ) -> Sensor[Any]:
        """Put a skin on a body, and return the handle by which you read it; the model sets the type of its reading.

        ``transducers`` (:mod:`tactemu.transducers`) act, in their order, between the model and the noise, resolution
        and saturation of the options, which are then in the unit of the last transducer. The reading is then one array,
        the signal of the last; give none rather than an empty list, which a type checker takes for such a signal.

        Raises:
            SceneError: the body is not in this scene, or the name is taken.
        """
        from tactemu.sensors.sensor import Sensor
        from tactemu.sensors.sensor_model import SensorModel

        if not isinstance(model, SensorModel):
            raise SceneError(f"add_sensor: expected a sensor such as tactemu.KinematicTaxel(...), got {model!r}")
        kind = type(model).__name__
        name = name or f"{kind}{len(self.sensors)}"
        if any(sensor.name == name for sensor in self.sensors):
            raise SceneError(f"sensor {name!r}: there is already a sensor of this name; choose another name")
        sensor: Sensor[Any] = Sensor(
            name, model, self.body(link), tuple(transducers), model.convention or self.convention
        )
        if sensor.transducers:
            require_on_skin([sensor], f"sensor {name!r}: transducers sense")
        _ = sensor._chain  # raises if the transducers do not fit
        sensor.names = self.names
        self.sensors.append(sensor)
        self._outdate(f"sensor {name!r} was added after the scene was built")
        return sensor

    def _outdate(self, why: str) -> None:
        """Mark the simulation built before as outdated: its sensors' handles no longer read it."""
        if self._built is not None:
            self._built._outdated, self._built = why, None

    def body(self, which: Body | str | int) -> Body:
        """Return a body of this scene, given the body itself, its name or its index.

        Raises:
            SceneError: there is none; the message lists the bodies.
        """
        return find_body(self.bodies, which)

    def build(
        self,
        n_envs: int | None = None,
        *,
        device: str | None = "cpu",
        seed: int = 0,
        dtype: Dtype = "float32",
        first_env: int = 0,
        threads: int | None = None,
        like: Simulation | None = None,
    ) -> Simulation:
        """Compile the scene for ``n_envs`` environments; ``None``: one, and readings have no environment axis.

        Args:
            n_envs: number of environments that are simulated in parallel.
            device: a Warp device, ``cpu`` or ``cuda:0``; ``None``: Warp's current one.
            seed: root of all random streams.
            dtype: number type of the kernels. With ``float64`` only mesh queries stay single precision.
            first_env: index of the first environment, if others are simulated elsewhere: an environment's random
                numbers depend on its index, not on the device.
            threads: number of CPU threads that share the environments; ``None``: one for each core, where that is
                faster. Readings are the same whatever the number. :meth:`Simulation.close` ends the threads.
            like: a simulation of an equal scene with the same options, with which constant data are shared.

        Raises:
            SceneError: an option of a sensor is wrong, a mesh cannot be used, or the device does not exist.
        """
        from tactemu.sensors.build_options import BuildOptions
        from tactemu.sensors.simulation import Simulation

        options = BuildOptions(
            n_envs=n_envs, device=device, seed=seed, dtype=dtype, first_env=first_env, threads=threads
        )
        simulation = Simulation(
            self.bodies, self.sensors, options, dt=self.dt, posers=self.posers, planners=self.planners, like=like
        )
        self._outdate("the scene was built again, and its sensors now read the new simulation")
        self._built, simulation.names = simulation, self.names
        return simulation

    def build_split(
        self,
        n_envs: int,
        devices: Sequence[str],
        *,
        seed: int = 0,
        dtype: Dtype = "float32",
        first_env: int = 0,
    ) -> SplitSimulation:
        """Compile the scene for a batch that several devices share: readings equal those of one device, bit for bit.

        You read the sensors by :meth:`SplitSimulation.read`; their handles in the scene stay as they were.

        Args:
            n_envs: number of environments of all devices together.
            devices: Warp devices, ``["cuda:0", "cuda:1"]``.
            seed: root of all random streams.
            dtype: as in :meth:`build`.
            first_env: as in :meth:`build`.

        Raises:
            SceneError: as in :meth:`build`, or there are fewer environments than devices.
        """
        from tactemu.sensors.split import SplitSimulation

        split = SplitSimulation(
            self.bodies, self.sensors, devices, n_envs=n_envs, first_env=first_env, dt=self.dt, seed=seed, dtype=dtype,
            posers=self.posers, planners=self.planners,
        )  # fmt: skip
        split.names = self.names
        return split
