"""A built scene: poses go in, the plan runs, readings come out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
import warp as wp

from tactemu.base.errors import PoseError, SceneError
from tactemu.base.kernels import start
from tactemu.base.options import check_declared
from tactemu.geometry.bodies import Body, find_body
from tactemu.geometry.motion import Pose
from tactemu.imperfections import Imperfections, ReadingInfo
from tactemu.imperfections.compile import Transduce
from tactemu.plan.plan import Context, Plan, Stage
from tactemu.plan.thread_pool import cores
from tactemu.sensors.bound_poses import BoundPoses, declared
from tactemu.sensors.drawing import check_drawing
from tactemu.sensors.point_cloud import PointCloud
from tactemu.sensors.poses import RelativePoses, complaint
from tactemu.sensors.restarts import Restarts
from tactemu.sensors.sensor import Sensor, bodies_felt, check_query
from tactemu.sensors.sensor_model import Site, upload_probes
from tactemu.sensors.shape_table import ShapeTables
from tactemu.sensors.world import World
from tactemu.transducers.transducer import SignalType, TransducerSite

MOST_THREADS = 2**31
"""Warp counts threads and the places of an array's axis in 31 bits."""
WORTH_A_THREAD = 2**14
"""Work of a step (:attr:`SensorModel.work` of all taxels) for which one more thread pays: it takes about 75 µs, and
waking a thread up to 50."""

_COUNTS = ("time_ns", "step_count", "_dt_ns", "_checked_step")
"""What is saved beside the arrays."""

REAL = {"float32": wp.float32, "float64": wp.float64}


def _device(name) -> wp.Device:
    start()
    try:
        return wp.get_device(name)
    except Exception as error:
        known = ", ".join(str(device) for device in wp.get_devices())
        raise SceneError(f"no device {name!r} on this machine ({error}); there are: {known}") from None


def _reading_info(sensor: Sensor, kind: SignalType | None = None) -> ReadingInfo:
    """What the imperfections must know of a sensor, of what its transducers give or of what its model does."""
    model, probes = sensor.model, sensor.probes
    return ReadingInfo(
        name=sensor.name,
        layout=probes.layout,
        channels=model.channels if kind is None else ("force",) if kind.vector else ("scalar",),
        unit=model.unit if kind is None else kind.unit,
        probe_radius=probes.radii,
        spacing=probes.spacing if probes.is_grid else None,
        normal=probes.mean_normal,
        gain_inside=model.gain_inside,
    )


def _areas(sensor: Sensor) -> np.ndarray:
    """Area of each taxel [m²]: as its model was told, its cell of a grid, or the circle of its probe."""
    probes, given = sensor.probes, getattr(sensor.model, "taxel_area", None)
    if given is None and probes.is_grid:
        given = abs(probes.spacing[0] * probes.spacing[1])
    if given is None or not np.all(np.asarray(given) > 0):  # a grid of one row or column has no spacing
        given = np.pi * np.asarray(probes.radii).reshape(-1) ** 2
    return np.broadcast_to(np.asarray(given, float).reshape(-1), (probes.n,))


def _middle(points: np.ndarray) -> np.ndarray:
    """Of the box around points ``(n, 3)``; the origin if there are none."""
    return 0.5 * (points.min(0) + points.max(0)) if len(points) else np.zeros(3)


def _as_it_is(array: wp.array, _branch: str) -> tuple[wp.array, list[Stage]]:
    return array, []


class Simulation:
    """What :meth:`tactemu.Scene.build` returns. Time is counted in integer nanoseconds and steps in int64.

    It is of the bodies and sensors, and steps by the ``dt``, that the scene has when it is built. With ``like``, one of
    the same scene and the same options, it shares what never changes.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self,
        bodies: Sequence[Body],
        sensors: Sequence[Sensor],
        *,
        dt: float,
        n_envs: int | None,
        device,
        seed: int,
        dtype: str,
        first_env: int = 0,
        threads: int | None = None,
        posers: Sequence[Callable[[Simulation, float], None]] = (),
        planners: Sequence[Callable[[Simulation], None]] = (),
        like: Simulation | None = None,
    ):
        if n_envs is not None and (isinstance(n_envs, bool) or int(n_envs) != n_envs or n_envs < 1):
            raise SceneError(f"build: n_envs must be None or a whole number >= 1, got {n_envs!r}")
        if isinstance(first_env, bool) or int(first_env) != first_env or not 0 <= first_env < MOST_THREADS:
            raise SceneError(f"build: first_env must be a whole number from 0 to {MOST_THREADS - 1}, got {first_env!r}")
        if dtype not in REAL:
            raise SceneError(f"build: dtype must be one of {', '.join(REAL)}, got {dtype!r}")
        self.bodies, self.sensors = tuple(bodies), tuple(sensors)
        self.dt = dt
        """Length of a step unless :meth:`step` is told otherwise [s]."""
        self.batched = n_envs is not None
        """Do readings have an environment axis?"""
        self.n_envs = 1 if n_envs is None else int(n_envs)
        self.device = _device(device)
        self.time_ns = 0
        self.step_count = 0
        self._threads_wanted = threads
        n_threads, why = self._share_out(threads)
        self.context = Context(
            device=self.device,
            n_envs=self.n_envs,
            real=REAL[dtype],
            seed=int(seed),
            first_env=int(first_env),
            constants={} if like is None else like.context.constants,
            threads=n_threads,
        )
        self.context.dt.fill_(dt)
        self.outdated = ""
        """Why it must not be stepped any more: its scene has changed, or was built again."""
        self._dt_ns = -1
        self._checked_step = 0
        attachments = self._compile(why)
        self.world = World(self.bodies, self._poses.world)
        self._moving = [body for body in self.bodies if body.motion is not None]
        self.restarts = Restarts(self.plan, self.world, self._arrays, self.device)
        self._bound: tuple[BoundPoses, Stage] | None = None
        self._in_graph = False
        self.posers = list(posers)
        """Called at each step with its time [s], after the motions: they pose bodies."""
        self._move(0.0)
        self._planners = list(planners)
        for plan in self._planners:
            plan(self)
        for attach in attachments:
            attach()

    # -- building ---------------------------------------------------------------------------------------------------

    def _share_out(self, threads: int | None) -> tuple[int, str]:
        """How many threads share the environments, and why, in words."""
        if threads is not None and (isinstance(threads, bool) or int(threads) != threads or threads < 1):
            raise SceneError(f"build: threads must be None or a whole number >= 1, got {threads!r}")
        if not self.device.is_cpu:
            if threads not in (None, 1):
                raise SceneError(f"build: threads is of a CPU, and this is {self.device}; leave it out")
            return 1, ""
        if self.n_envs == 1:
            return 1, " (one environment)"
        each = f" of {self.n_envs} environments"
        if threads is not None:
            found = min(int(threads), self.n_envs)
            return found, f" (as asked for), {-(-self.n_envs // found)}{each} at most to each"
        work = self.n_envs * sum(sensor.model.work * sensor.probes.n for sensor in self.sensors)
        pays = max(1, int(work // WORTH_A_THREAD))
        found = min(cores(), self.n_envs, pays)
        if found == 1:
            return 1, " (a step is too short for more)" if pays == 1 else " (one core)"
        return found, f", {-(-self.n_envs // found)}{each} at most to each"

    def _compile(self, why_threads: str) -> list[Callable[[], None]]:
        """Fill the plan. Returns what connects the sensors' handles, to be called when all is well."""
        links = sorted({sensor.link.index for sensor in self.sensors})
        reasons = [f"{s.name} ({why})" for s in self.sensors if (why := s.model.velocity_reason())]
        skins = {link: [s.probes.positions for s in self.sensors if s.link.index == link] for link in links}
        middles = np.array([_middle(np.concatenate(each)) for each in skins.values()]).reshape(-1, 3)
        self._poses = RelativePoses(links, len(self.bodies), reasons, middles, self.context)
        self.plan = Plan(device=self.device, threads=self.context.threads, why_threads=why_threads)
        if self.sensors:
            self.plan.stages += self._poses.stages()
        constants = self.context.constants
        self._shapes: ShapeTables = constants.setdefault(ShapeTables, ShapeTables(self.bodies, self.context))
        self._clouds: dict[tuple[int, int], PointCloud] = constants.setdefault(PointCloud, {})
        self._arrays: list[wp.array] = []
        attachments = [self._compile_sensor(sensor) for sensor in self.sensors]
        self._bad_view = self._poses.bad.numpy() if self.device.is_cpu else None
        return attachments

    def _check(self, sensor: Sensor) -> None:
        n_taxels = self.n_envs * sensor.probes.n
        if n_taxels >= MOST_THREADS:
            raise SceneError(
                f"sensor {sensor.name!r}: {self.n_envs} environments of {sensor.probes.n} taxels are {n_taxels}; "
                f"one launch takes {MOST_THREADS - 1} taxels: build fewer environments at a time"
            )
        check_query(sensor)
        check_drawing(f"sensor {sensor.name!r}", sensor.model)
        sensor.model.validate(sensor.probes)
        check_declared(f"sensor {sensor.name!r}", sensor.model, sensor.model.unbounded)

    def _site(self, sensor: Sensor, gain, radius) -> Site:
        felt = bodies_felt(sensor, self.bodies)
        return Site(
            name=sensor.name,
            model=sensor.model,
            context=self.context,
            link=sensor.link,
            probes=sensor.probes,
            n_channels=sensor.model.n_channels,
            view=self._poses.view(sensor.link.index),
            target_bodies=felt,
            targets=wp.array([body.index for body in felt], dtype=wp.int32, device=self.device),
            shapes=self._shapes,
            clouds=self._clouds,
            **upload_probes(sensor.probes, self.context),
            gain=gain,
            radius=radius,
        )

    def _compile_sensor(self, sensor: Sensor) -> Callable[[], None]:
        """Plan the stages of one sensor in their order: what enters its formula, the formula, what spoils its result.
        Returns what connects its handle."""
        model = sensor.model
        self._check(sensor)
        imperfections = Imperfections(model, _reading_info(sensor), self.context)
        gain, gain_stages = imperfections.compile_gain()
        radius, radius_stages = imperfections.compile_radius_noise()
        compiled = model.compile(self._site(sensor, gain if model.gain_inside else None, radius))
        finish = compiled.finish or (lambda array, _branch: (array, []))
        transduce: Transduce | None = None
        if sensor.chain is None:
            truth, truth_stages = finish(compiled.truth, "truth")
        else:  # neither what a model adds at the end nor how it presents its own survives a transducer
            truth, truth_stages, info = self._transduce(sensor, compiled.truth)

            transduce = partial(self._transduced, sensor, compiled.truth, (truth, [], info))
        values, value_stages = imperfections.compile_values(compiled.raw, transduce)
        untouched = values is (compiled.truth if sensor.chain is None else truth)
        last = finish if sensor.chain is None else _as_it_is
        values, finish_stages = (truth, []) if untouched else last(values, "measured")
        measured, delivery_stages = imperfections.compile_delivery(values)
        remembered, history_stages = (measured, []) if truth is measured else imperfections.compile_history(truth)
        self._arrays += [compiled.truth, compiled.raw, truth, remembered, values, measured]
        self.plan.stages += (
            imperfections.compile_resets() + gain_stages + radius_stages + compiled.stages + truth_stages
        )
        self.plan.stages += value_stages + finish_stages + delivery_stages + history_stages
        present = compiled.present if sensor.chain is None else None
        own = {} if sensor.chain is not None else compiled.derived
        status = self._poses.status(sensor.link.index)
        return partial(sensor.attach, self, imperfections, remembered, measured, present, own, status)

    def _transduced(
        self, sensor: Sensor, raw: wp.array, done: tuple[wp.array, list[Stage], ReadingInfo], array: wp.array
    ) -> tuple[wp.array, list[Stage], ReadingInfo]:
        """Return the measured branch's transducers: those of the truth, ``done``, where nothing has touched what
        goes in.
        """
        return done if array is raw else self._transduce(sensor, array)

    def _transduce(self, sensor: Sensor, array: wp.array) -> tuple[wp.array, list[Stage], ReadingInfo]:
        """Plan a sensor's transducers for one branch."""
        assert sensor.chain is not None
        probes, view = sensor.probes, self._poses.view(sensor.link.index)
        site = TransducerSite(
            name=sensor.name,
            context=self.context,
            positions=probes.positions,
            normals=probes.normals,
            layout=probes.layout,
            areas=_areas(sensor),
            link=sensor.link.index,
            world=self._poses.world,
            pose=view.pose,
            bodies={body.name: body.index for body in self.bodies},
        )
        out, stages = sensor.chain.compile(site, array)
        return out, stages, _reading_info(sensor, sensor.chain.output)

    @property
    def clouds(self) -> list[PointCloud]:
        """Points that were sampled on bodies."""
        return list(self._clouds.values())

    @property
    def uses_velocity(self) -> bool:
        """Does any sensor need the velocities of bodies?"""
        return self._poses.with_twist

    # -- stepping ---------------------------------------------------------------------------------------------------

    def set_pose(
        self,
        body: Body | str | int,
        *,
        position=None,
        quaternion=None,
        linear_velocity=None,
        angular_velocity=None,
        envs: Sequence[int] | np.ndarray | None = None,
    ) -> None:
        """Put a body somewhere, from the next step on. What is not given stays as it is.

        Args:
            body: the body, its name or its index.
            position: of its origin, world [m]; ``(3,)`` for all environments or ``(n_envs, 3)``. Numpy, lists, Warp
                arrays or anything with ``__dlpack__``; arrays on the simulation's device are not copied through the
                host.
            quaternion: its orientation, (w, x, y, z), any length; ``(4,)`` or ``(n_envs, 4)``.
            linear_velocity: of its origin, world [m/s].
            angular_velocity: world [rad/s].
            envs: the environments to set; arrays then have ``len(envs)`` rows.

        Raises:
            SceneError: the body is fixed or unknown, or a shape is wrong.
        """
        if isinstance(body, Body) and body not in self.bodies:
            raise SceneError(
                f"set_pose: body {body.name!r} was added after the scene was built, or is of another; build it again"
            )
        body = find_body(self.bodies, body)
        if body.fixed:
            raise SceneError(f"set_pose: body {body.name!r} is fixed; add it with fixed=False to move it")
        given = (position, quaternion, linear_velocity, angular_velocity)
        self.world.set(body, given, envs)

    @property
    def pose_array(self) -> wp.array:
        """Poses of all bodies, float64, shape ``(n_envs, n_bodies, 13)``: position [m], quaternion (w, x, y, z),
        velocity of the body's origin [m/s], angular velocity [rad/s], in the world.

        It is the memory that a step reads: what is written there on the device, by whomever, holds from the next step
        on. ``torch.from_dlpack(sim.pose_array)`` copies nothing.
        """
        return self.world.exposed()

    def bind_poses(
        self,
        poses=None,
        *,
        position=None,
        quaternion=None,
        linear_velocity=None,
        angular_velocity=None,
        order: str = "wxyz",
        velocity_at: Any = "origin",
        velocity_at_index: Sequence[int] | np.ndarray | None = None,
        com=None,
        index: Mapping[Any, int] | None = None,
        offsets: Mapping[Any, tuple[Any, Any]] | None = None,
    ) -> None:
        """Take poses from arrays of another simulator, now and at each step.

        They stay where they are, on the simulation's device: Warp or NumPy arrays, or anything with ``__dlpack__``,
        float32 or float64, strided as they may be. One launch converts them, within the step. Called again, it replaces
        what was bound.

        Args:
            poses: all in one array ``(n_envs, n, 13)``, as :attr:`pose_array`.
            position: of the bodies' origins, world [m]: ``(n_envs, n, 3)``, or ``(n_envs * n, 3)`` with the bodies of
                one environment after those of another. A pair ``(array, k)`` stands for its numbers from ``k`` on.
            quaternion: their orientations, any length; as wide as 4.
            linear_velocity: [m/s], world.
            angular_velocity: [rad/s], world. What is not given stays as it is.
            order: of a quaternion's numbers, ``wxyz`` or ``xyzw``.
            velocity_at: whose velocity it is: of the ``origin``, of the centre of mass (``com``), or of the body's
                material at points in the world, an array ``(n_envs, n, 3)``.
            velocity_at_index: which of these points is whose, ``(n,)``; default: point k is of place k.
            com: centres of mass in the frames that are given [m], ``(n, 3)`` or as ``position``.
            index: which of the n places is whose, ``{body: place}``; default: place k is body k, fixed ones left alone.
            offsets: where bodies are in the frames that are given, ``{body: (position, quaternion)}``; default: there.

        Raises:
            SceneError: an array has the wrong shape, type or device, or no memory; a body is fixed, or has a motion.
        """
        parts = {
            "position": position,
            "quaternion": quaternion,
            "linear_velocity": linear_velocity,
            "angular_velocity": angular_velocity,
        }
        said = {"order": order, "velocity_at": velocity_at, "velocity_at_index": velocity_at_index, "com": com}
        said |= {"index": index, "offsets": offsets}
        bound = declared(self.bodies, self.context, poses=poses, parts=parts, **said)
        stage = bound.stage(self.context, self._poses.world)
        self.plan.insert(stage, before="relative poses")
        self._bound = bound, stage
        self._take_bound()

    def _take_bound(self) -> None:
        """Take the poses that are bound as the other simulator has them now."""
        if self._bound is not None:
            bound, stage = self._bound
            self.world.bind(frozenset(body.index for body in bound.bodies))
            stage.launch()

    def add_stage(self, stage: Stage) -> None:
        """Run one more stage at the end of each step, and run it now."""
        self.plan.insert(stage)
        stage.launch()

    def step(self, dt: float | None = None) -> None:
        """Advance the time by ``dt`` [s] (default: the scene's), move what has a motion, and run the plan.

        Raises:
            PoseError: a pose is not finite (on a GPU: at the next read). All environments have been computed; those
                with such a pose read NaN.
            ValueError: ``dt`` is negative or not finite, less than a nanosecond but not 0, or too short for what
                sensors keep of the past (delay, scan).
            SceneError: the scene has changed since, or was built again.
        """
        if self.outdated:
            raise SceneError(f"step: {self.outdated}; go on with what scene.build() returns now")
        dt = self.dt if dt is None else dt
        if not (dt >= 0.0 and math.isfinite(dt)):
            raise ValueError(f"step: dt must be a time >= 0 s, got {dt!r}")
        dt_ns = round(dt * 1e9)
        if dt_ns == 0 < dt:
            raise ValueError(f"step: time is counted in nanoseconds; dt must be 0 or at least 1e-9 s, got {dt!r}")
        if dt_ns != self._dt_ns:
            for sensor in self.sensors:
                assert sensor.imperfections is not None
                sensor.imperfections.check_step(dt)
            self.context.dt.fill_(dt)
            self._poses.dt_ns.fill_(dt_ns)
            self._dt_ns = dt_ns
        if self.device.is_cuda and wp.get_stream(self.device).is_capturing:
            self._step_within_capture()
            return
        self.time_ns += dt_ns
        self.step_count += 1
        self._move(self.time_ns * 1e-9)
        self.world.upload()
        self.plan.run()
        if self._bad_view is not None and self._bad_view.any():
            self.check()

    def _step_within_capture(self) -> None:
        """Leave a step in a graph that somebody else captures; steps of that graph are counted on the device only."""
        if not self.plan.loaded:
            raise SceneError("step: a first step loads what a graph may not; take one before you capture")
        if self._moving or self.posers:
            raise SceneError("step: what has a motion, or is posed from Python, cannot be captured in a graph")
        if self.world.waiting:
            raise SceneError("step: poses set from the host wait to be sent; take a step before you capture")
        self._in_graph = True
        self.plan.run_within_capture()

    @property
    def dt_ns(self) -> int:
        """Length of a step unless :meth:`step` is told otherwise [ns]."""
        return round(self.dt * 1e9)

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step of ``dt`` fits before ``t_ns``.

        Args:
            t_ns: simulated time to reach [ns].
            max_steps: at most so many steps; the first is stretched over what is left too much. For a loop in real
                time that has fallen behind: it must not fall further behind by catching up.

        Returns:
            Whether a step was stretched.
        """
        dt_ns = self.dt_ns
        steps = (t_ns - self.time_ns) // dt_ns if dt_ns else 0
        if max_steps is None or steps <= max_steps:
            for _ in range(steps):
                self.step()
            return False
        self.step((steps - max_steps + 1) * dt_ns * 1e-9)
        for _ in range(max_steps - 1):
            self.step()
        return True

    def _move(self, t_s: float) -> None:
        for body in self._moving:
            self.world.put(body.index, body.pose(t_s))
        for pose in self.posers:
            pose(self, t_s)

    def pose(self, body: Body) -> Pose:
        """Where a body is and how it moves, as last set, in the world of environment 0."""
        return self.world.pose(body.index)

    def check(self) -> None:
        """Wait for the device, and raise if a pose of the last step was not usable.

        Raises:
            PoseError: naming body, environments and step; once per step.
        """
        if self._checked_step == self.step_count and not self._in_graph:
            return
        self._checked_step = self.step_count
        for stage in self.plan.stages:
            if stage.check is not None:
                stage.check()
        bad = np.asarray(self._poses.bad.numpy().any(axis=0))
        if not bad.any():
            return
        values = self.world.download()
        raise PoseError(complaint(self.bodies, values, bad, self.step_count, self.context.real))

    def before_read(self) -> None:
        """On a GPU poses are judged here, since a step does not wait for the device."""
        if self._bad_view is None and self.step_count:
            self.check()

    def clone(self) -> Simulation:
        """Return one of the same bodies, with handles of its own on the same sensors, at its start."""
        return Simulation(
            self.bodies,
            [sensor.clone() for sensor in self.sensors],
            dt=self.dt,
            n_envs=self.n_envs if self.batched else None,
            device=self.device,
            seed=self.context.seed,
            dtype=self.context.real.__name__,
            first_env=self.context.first_env,
            threads=self._threads_wanted,
            posers=self.posers,
            planners=self._planners,
            like=self,
        )

    def close(self) -> None:
        """End the threads that share its steps; another step starts them again. Without any it does nothing."""
        self.plan.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    # -- saving -----------------------------------------------------------------------------------------------------

    def extra_state(self) -> dict[str, Any]:
        """What moves the bodies, and may have a state of its own."""
        posers = {f"posers[{k}]": getattr(pose, "__self__", None) for k, pose in enumerate(self.posers)}
        return {f"motion of {body.name}": body.motion for body in self._moving} | posers

    def state(self) -> dict[str, Any]:
        """Return all that lasts from step to step, arrays copied to the host."""
        self.world.upload()
        counts = {name: getattr(self, name) for name in _COUNTS}
        return counts | {"memory": tuple(array.numpy().copy() for array in self.context.memory)}

    def other_state(self) -> dict[str, Any]:
        """Return examples of numbers that are not finite, of the arrays that may have some."""
        context = self.context
        return {"memory": tuple(np.full(int(k in context.infinite), np.nan) for k in range(len(context.memory)))}

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """What takes on a state, of this or another process, once it is called.

        Raises:
            ValueError: it is not one of such a simulation.
        """
        counts = {name: int(state[name]) for name in _COUNTS}
        arrays, given = self.context.memory, state["memory"]
        if len(given) != len(arrays):
            raise ValueError(f"expected {len(arrays)} arrays, got {len(given)}")
        for k, (array, values) in enumerate(zip(arrays, given)):
            here = array.numpy()
            if (values.shape, values.dtype) != (here.shape, here.dtype):
                there = f"{values.shape} {values.dtype}"
                raise ValueError(f"array {k}: expected {here.shape} {here.dtype}, got {there}")
            if array is self.context.step and values.min() < 0:
                raise ValueError(f"array {k}: expected a number of steps, got {values.min()}")

        def take() -> None:
            vars(self).update(counts)
            for array, values in zip(arrays, given):
                if self.device.is_cpu:
                    array.numpy()[...] = values
                else:
                    array.assign(values)
            self.world.resumed()

        return take

    def reset(self, envs: Any = None) -> None:
        """Clear all state, put bodies back where they started, and let readings be 0 until the next step. Bodies whose
        poses are bound stay where the other simulator has them.

        Args:
            envs: the environments to reset: indices, a mask, or a mask (bool or uint8) in an array on the simulation's
                device (Warp, torch, anything with ``__dlpack__``), for which nothing waits for the device. ``None``:
                all, and the time and the step count start at 0 again.

        Raises:
            SceneError: an environment is not there; a mask has the wrong length, type or device.
        """
        self.restarts.reset(envs)
        if envs is None:
            self.time_ns = self.step_count = self._checked_step = 0
            self.context.step.fill_(0)
            self.context.time_ns.fill_(0)
            self._move(0.0)
        self._take_bound()
