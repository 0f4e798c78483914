"""A scene: bodies, and skins on them. Building it compiles the plan of what has to be computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.options import number
from tactemu.geometry.bodies import Body, WorldMotion, find_body
from tactemu.geometry.shapes.registry import SHAPES
from tactemu.geometry.shapes.shape import Shape

if TYPE_CHECKING:
    from tactemu.geometry.motion import Motion
    from tactemu.plan.plan import Dtype
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.sensor_model import SensorModel
    from tactemu.sensors.simulation import Simulation
    from tactemu.sensors.split import SplitSimulation
    from tactemu.transducers.transducer import Transducer


class Scene:
    """What is there, before anything is computed.

    Args:
        dt: time that one step advances [s], a nanosecond or more: time is counted in them.
    """

    def __init__(self, dt: float = 1e-3):
        self.dt = number("Scene", "dt", dt, at_least=1e-9, unit="s")
        self.bodies: list[Body] = []
        self._names: set[str] = set()
        """Names of the bodies."""
        self.sensors: list[Sensor] = []
        self.posers: list[Callable[[Simulation, float], None]] = []
        """What poses bodies at each step of the built scene, with its time [s]: another simulator."""
        self.planners: list[Callable[[Simulation], None]] = []
        """What adds stages of its own to a scene that is built: another simulator on its device."""
        self._built: Simulation | None = None

    def add_body(
        self,
        shape: Shape | None = None,
        *,
        name: str | None = None,
        fixed: bool = False,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        motion: Motion | WorldMotion | None = None,
    ) -> Body:
        """Add a rigid body.

        Args:
            shape: its geometry; ``None`` makes a bare frame.
            name: for messages and the plan; default: the shape's name and its index.
            fixed: never moves; a motion or :meth:`Simulation.set_pose` on it is an error.
            position: where it starts, world [m].
            quaternion: its orientation there, (w, x, y, z); need not be of unit length.
            motion: moves it: a motion of :mod:`tactemu.geometry.motion`, which displaces it from there, or an object
                whose ``pose(t_s)`` gives world poses (:class:`tactemu.Pose`).

        Raises:
            SceneError: an option is wrong, or the name is taken.
        """
        if shape is not None and not isinstance(shape, Shape):
            raise SceneError(f"add_body: expected a shape ({', '.join(SHAPES)}) or None, got {shape!r}")
        index = len(self.bodies)
        kind = type(shape).__name__.lower() if shape is not None else "frame"
        name = name or f"{kind}{index}"
        if name in self._names:
            raise SceneError(f"body {name!r}: there is already a body of this name; give another")
        if fixed and motion is not None:
            raise SceneError(f"body {name!r}: it is fixed and has a motion; drop one of the two")
        xyz, wxyz = np.asarray(position, float), np.asarray(quaternion, float)
        if xyz.shape != (3,) or not np.isfinite(xyz).all():
            raise SceneError(f"body {name!r}: position must be 3 finite numbers, got {position!r}")
        with np.errstate(over="ignore"):
            length = np.linalg.norm(wxyz)
        if wxyz.shape != (4,) or not np.isfinite(length) or length < 1e-6:
            raise SceneError(f"body {name!r}: quaternion must be 4 numbers (w, x, y, z), not all 0, got {quaternion!r}")
        wxyz = wxyz / length
        x, y, z = map(float, xyz)
        qw, qx, qy, qz = map(float, wxyz)
        body = Body(index, name, shape, fixed, (x, y, z), (qw, qx, qy, qz), motion)
        self.bodies.append(body)
        self._names.add(name)
        self._outdate(f"body {name!r} was added after the scene was built")
        return body

    def add_sensor(
        self,
        model: SensorModel,
        *,
        link: Body | str | int,
        name: str | None = None,
        transducers: Sequence[Transducer] = (),
    ) -> Sensor:
        """Put a skin on a body; returns the handle to read it by.

        ``transducers`` (:mod:`tactemu.transducers`) come, in their order, between what the model gives and the noise,
        resolution and saturation of the options, which are then in the unit of the last.

        Raises:
            SceneError: the body is not of this scene, or the name is taken.
        """
        from tactemu.sensors.sensor import Sensor
        from tactemu.sensors.sensor_model import SensorModel

        if not isinstance(model, SensorModel):
            raise SceneError(f"add_sensor: expected a sensor such as tactemu.KinematicTaxel(...), got {model!r}")
        kind = type(model).__name__
        name = name or f"{kind}{len(self.sensors)}"
        if any(sensor.name == name for sensor in self.sensors):
            raise SceneError(f"sensor {name!r}: there is already a sensor of this name; give another")
        sensor = Sensor(name, model, self.body(link), tuple(transducers))
        for each in sensor.transducers:
            each.check_all(f"sensor {name!r}")
        _ = sensor.chain  # refuses what does not fit
        self.sensors.append(sensor)
        self._outdate(f"sensor {name!r} was added after the scene was built")
        return sensor

    def _outdate(self, why: str) -> None:
        """What was built before is no longer this scene, and its sensors' handles are not its own: it says so."""
        if self._built is not None:
            self._built.outdated, self._built = why, None

    def body(self, which: Body | str | int) -> Body:
        """Find a body by itself, its name or its index.

        Raises:
            SceneError: there is none; the message lists those there are.
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
            n_envs: environments simulated side by side.
            device: a Warp device, ``cpu`` or ``cuda:0``; ``None``: Warp's current one.
            seed: root of all random streams.
            dtype: numbers of the kernels. In ``float64`` only mesh queries stay single precision.
            first_env: number of the first of them, where others are simulated elsewhere: an environment has the random
                numbers of its number, on whatever device.
            threads: of a CPU, that share the environments; ``None``: one for each core, where that pays. Readings are
                the same whatever their number. :meth:`Simulation.close` ends them.
            like: a simulation of an equal scene with the same options, which shares what never changes.

        Raises:
            SceneError: an option of a sensor is wrong, a mesh cannot be used, or the device does not exist.
        """
        from tactemu.sensors.simulation import Simulation

        simulation = Simulation(
            self.bodies, self.sensors, dt=self.dt, n_envs=n_envs, device=device, seed=seed, dtype=dtype,
            first_env=first_env, threads=threads, posers=self.posers, planners=self.planners, like=like,
        )  # fmt: skip
        self._outdate("the scene was built again, and its sensors read the new simulation")
        self._built = simulation
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
        """Compile the scene for a batch that several devices share: readings are those of one device, bit for bit.

        Its sensors are read by :meth:`SplitSimulation.read`, and their handles of the scene stay as they were.

        Args:
            n_envs: environments of all devices.
            devices: Warp devices, ``["cuda:0", "cuda:1"]``.
            seed: root of all random streams.
            dtype: as of :meth:`build`.
            first_env: as of :meth:`build`.

        Raises:
            SceneError: as of :meth:`build`; fewer environments than devices.
        """
        from tactemu.sensors.split import SplitSimulation

        return SplitSimulation(
            self.bodies, self.sensors, devices, n_envs=n_envs, first_env=first_env, dt=self.dt, seed=seed, dtype=dtype,
            posers=self.posers, planners=self.planners,
        )  # fmt: skip
