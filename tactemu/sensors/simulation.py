"""A built scene: a step takes poses, runs the plan, and leaves readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
import warp as wp

from tactemu.base.errors import PoseError, SceneError
from tactemu.base.keywords import takes_words
from tactemu.geometry.bodies import Body
from tactemu.plan.plan import Context, Plan, Stage
from tactemu.sensors.build_options import REAL, BuildOptions, device_of
from tactemu.sensors.motions import Motions
from tactemu.sensors.point_cloud import PointCloud
from tactemu.sensors.pose_input import PoseInput
from tactemu.sensors.poses import RelativePoses, pose_error_message
from tactemu.sensors.resets import Resets
from tactemu.sensors.sensor import Sensor
from tactemu.sensors.sensor_compiler import SensorCompiler
from tactemu.sensors.thread_count import thread_count
from tactemu.sensors.world import World, on_host

_COUNTS = ("time_ns", "step_count", "_dt_ns", "_checked_step")
"""The attributes that are saved beside the arrays."""


def _check_number(n: Any) -> None:
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        raise ValueError(f"step: n is a number of steps, a whole number >= 0, got {n!r}; a step's length [s] is dt=")


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the centre of the box around points ``(n, 3)``; the origin if there are none."""
    return 0.5 * (points.min(0) + points.max(0)) if len(points) else np.zeros(3)


class Simulation(PoseInput):
    """The simulation that :meth:`tactemu.Scene.build` returns. Time is counted in integer nanoseconds and steps in
    int64.

    It has the bodies, the sensors and the ``dt`` that the scene has when it is built. With ``like``, a simulation of
    the same scene with the same options, it shares that simulation's constants.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self,
        bodies: Sequence[Body],
        sensors: Sequence[Sensor],
        options: BuildOptions,
        *,
        dt: float,
        posers: Sequence[Callable[[Simulation, Any], None]] = (),
        planners: Sequence[Callable[[Simulation], None]] = (),
        like: Simulation | None = None,
    ):
        self.bodies, self.sensors = tuple(bodies), tuple(sensors)
        self.dt = dt
        """Length of a step unless you pass another to :meth:`step` [s]."""
        self.batched = options.n_envs is not None
        """Do readings have an environment axis?"""
        self.n_envs = 1 if options.n_envs is None else int(options.n_envs)
        self.device = device_of(options.device)
        self.time_ns = 0
        self.step_count = 0
        self._options = options
        n_threads, why = thread_count(options.threads, self.device, self.n_envs, self.sensors)
        self.context = Context(
            device=self.device,
            n_envs=self.n_envs,
            real=REAL[options.dtype],
            seed=int(options.seed),
            first_env=int(options.first_env),
            constants={} if like is None else like.context.constants,
            threads=n_threads,
        )
        """The device, the number of environments and the time, as stages of a plan read them."""
        self.context.dt.fill_(dt)
        self._outdated = ""
        """The reason why it must not be stepped any more: its scene has changed, or was built again. Empty while it
        may."""
        self._dt_ns, self._length = -1, -1.0
        self._checked_step = 0
        attachments = self._compile(why)
        self._resets = Resets(self.plan, self.context, self._world, self._compiler.arrays)
        self._bound = None
        self._in_graph = False
        self._added: list[Stage] = []
        """The stages that users asked for after the build; their arrays are no state."""
        self.posers = list(posers)
        """Functions that pose bodies; each step calls them after the motions with its time [s], since the reset; in a
        batch with the times of all environments, ``(n_envs,)``."""
        self._movers = [body.motion for body in self.bodies] + [getattr(each, "__self__", None) for each in posers]
        """The objects that move the bodies, which may be parts with a state of their own."""
        self._world.upload()
        self._motions.show_start()
        self._move()
        self._planners = list(planners)
        for plan in self._planners:
            plan(self)
        for attach in attachments:
            attach()

    def __dir__(self) -> list[str]:
        """Return the attributes that an interactive shell offers, without those of the emulator's loop."""
        return [name for name in super().__dir__() if name not in ("TRANSIENT_FIELDS", "context", "posers")]

    # -- building ---------------------------------------------------------------------------------------------------

    def _compile(self, why_threads: str) -> list[Callable[[], None]]:
        """Make the world, fill the plan, and return the functions that connect the sensors' handles, to be called once
        all else has succeeded."""
        links = sorted({sensor.link.index for sensor in self.sensors})
        reasons = [f"{s.name} ({why})" for s in self.sensors if (why := s.model.velocity_reason())]
        skins = {link: [s._probes.positions for s in self.sensors if s.link.index == link] for link in links}
        middles = np.array([_middle(np.concatenate(each)) for each in skins.values()]).reshape(-1, 3)
        self._poses = RelativePoses(links, len(self.bodies), reasons, middles, self.context)
        self.plan = Plan(device=self.device, threads=self.context.threads, why_threads=why_threads)
        self.plan.stages += self._poses.stages()
        self._world = World(self.bodies, self._poses.world)
        self._motions = Motions(
            self.bodies, self._world, self.context, self._poses.dt_ns, ahead=self._poses.ahead, batched=self.batched
        )
        for stage in self._motions.stages():
            self.plan.insert(stage, before="relative poses")
        self._compiler = SensorCompiler(self.bodies, self._poses, self.context)
        attachments = [self._compiler.compile(sensor, self) for sensor in self.sensors]
        self.plan.stages += self._compiler.stages
        self._bad_poses = self._poses.bad.numpy().reshape(-1).data if self.device.is_cpu else None
        return attachments

    @property
    def _clouds(self) -> list[PointCloud]:
        """The points that were sampled on bodies."""
        return list(self._compiler.clouds.values())

    @property
    def _uses_velocity(self) -> bool:
        """Does any sensor need the velocities of bodies?"""
        return self._poses.with_twist

    # -- stepping ---------------------------------------------------------------------------------------------------

    def _add_stage(self, stage: Stage) -> None:
        """Add a stage to the end of each step, and run it now."""
        self.plan.insert(stage)
        self._added.append(stage)
        stage.launch()

    def step(self, n: int = 1, *, dt: float | None = None) -> None:
        """Take ``n`` steps: each advances the time, moves the bodies that have a motion, and runs the plan.

        Args:
            n: number of steps, a whole number >= 0.
            dt: length of each [s]; default: the scene's.

        Raises:
            PoseError: a pose is not finite (on a GPU: at the next read). All environments have been computed; those
                with such a pose read NaN.
            ValueError: ``n`` is no whole number >= 0; or ``dt`` is negative or not finite, less than a nanosecond but
                not 0, or too short for what sensors keep of the past (delay, scan).
            SceneError: the scene has changed since it was built, or was built again.
        """
        if self._outdated:
            raise SceneError(f"step: {self._outdated}; use the simulation that scene.build() returns now")
        if n.__class__ is not int or n < 0:  # first, and cheap, as all of this: a step takes some microseconds
            _check_number(n)
        length = self.dt if dt is None else dt
        if length != self._length:
            self._set_length(length)
        step = self._step
        if self._bad_poses is None and wp.get_stream(self.device).is_capturing:
            step = self._step_within_capture
        for _ in range(n):
            step()

    def _set_length(self, dt: float) -> None:
        """Set the length of the steps to take [s]."""
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
        self._length = dt

    def _step(self) -> None:
        self.time_ns += self._dt_ns
        self.step_count += 1
        if self.posers or self._motions.has_python:
            self._move()
        self._world.upload()
        self.plan.run()
        if self._bad_poses is not None and 1 in self._bad_poses.tobytes():  # NumPy's any() takes as long as a kernel
            self.check()

    def _step_within_capture(self) -> None:
        """Record a step in a graph that the caller captures; steps of that graph are counted on the device only."""
        if not self.plan.has_run:
            raise SceneError("step: take one step before you capture one; it loads what a graph cannot load")
        if reason := self._python_moves():
            raise SceneError(f"step: a graph cannot capture what Python computes: {reason}; bind their poses instead")
        if self._world.has_unsent:
            raise SceneError(
                "step: poses that you set from the host are not sent yet; take a step before you capture one"
            )
        self._in_graph = True
        self.plan.run_within_capture()

    @property
    def time(self) -> float:
        """The simulated time [s]: :attr:`time_ns` in seconds."""
        return self.time_ns * 1e-9

    @property
    def env_time(self) -> np.ndarray:
        """The simulated time of each environment since its own reset [s], float64, shape ``(n_envs,)``. On a GPU it
        waits for the device, which also counts the steps of your graphs."""
        return (self.context.time_ns.numpy() - self.context.began_ns.numpy()) * 1e-9

    @property
    def dt_ns(self) -> int:
        """Length of a step unless you pass another to :meth:`step` [ns]."""
        return round(self.dt * 1e9)

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step of ``dt`` fits before ``t_ns``.

        Args:
            t_ns: simulated time to reach [ns].
            max_steps: maximum number of steps; the first is stretched over the excess. It keeps a loop in real time
                that has fallen behind from falling further behind while it catches up.

        Returns:
            True if a step was stretched.
        """
        dt_ns = self.dt_ns
        steps = max((t_ns - self.time_ns) // dt_ns, 0) if dt_ns else 0
        if max_steps is None or steps <= max_steps:
            if steps:
                self.step(steps)
            return False
        self.step(dt=(steps - max_steps + 1) * dt_ns * 1e-9)
        self.step(max_steps - 1)
        return True

    def _move(self) -> None:
        self._motions.move(self.time_ns)
        for pose in self.posers:
            pose(self, self._motions.times(self.time_ns))

    def _python_moves(self) -> str:
        """Return what Python moves at each step, as a phrase; empty if nothing."""
        names = self._motions.in_python
        moved = [f"the motions of {', '.join(names)}"] if names else []
        return " and ".join([*moved, *["functions that pose bodies"][: len(self.posers)]])

    def check(self) -> None:
        """Wait for the device, and raise an error if a pose of the last step was not usable.

        Raises:
            PoseError: a pose was not usable; it names body, environments and step; once per step.
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
        values = self._world.download()
        raise PoseError(pose_error_message(self.bodies, values, bad, self.step_count, self.context.real))

    def _before_read(self) -> None:
        """Check the poses of the last step on a GPU, where a step does not wait for the device."""
        if self._bad_poses is None and self.step_count:
            self.check()

    def clone(self) -> Simulation:
        """Return a simulation of the same bodies at its start, with separate handles on the same sensors."""
        clone = Simulation(
            self.bodies,
            [sensor._clone() for sensor in self.sensors],
            replace(self._options, device=self.device),
            dt=self.dt,
            posers=self.posers,
            planners=self._planners,
            like=self,
        )
        clone.names = self.names
        return clone

    def close(self) -> None:
        """End the threads that share its steps; another step starts them again. Without threads it does nothing."""
        self.plan.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    # -- saving -----------------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Return the state that lasts from step to step, arrays copied to the host."""
        self._world.upload()
        counts = {name: getattr(self, name) for name in _COUNTS}
        return counts | {"memory": tuple(array.numpy().copy() for array in self.context.memory)}

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """Return a callable that restores a state of this or another process.

        Raises:
            ValueError: the state is not that of such a simulation.
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
            if k not in self.context.infinite and not np.isfinite(values).all():
                raise ValueError(f"array {k}: expected finite numbers, got {values[~np.isfinite(values)].flat[0]}")
            if array is self.context.step and values.min() < 0:
                raise ValueError(f"array {k}: expected a number of steps, got {values.min()}")

        def take() -> None:
            vars(self).update(counts)
            self._length = -1.0  # the next step looks anew
            for array, values in zip(arrays, given):
                if self.device.is_cpu:
                    array.numpy()[...] = values
                else:
                    array.assign(values)
            self._world.after_restore()
            self._motions.after_restore()
            for stage in self._added:
                stage.launch()

        return take

    @takes_words
    def reset(self, envs: Any = None, *, seed: Any = None) -> None:
        """Clear all state, put bodies back where they started, begin their motions anew, and set readings to 0 until
        the next step. Bodies that you have posed are given back to their motions. Bodies with bound poses stay where
        the other simulator has them.

        Args:
            envs: the environments to reset: indices, a mask, or a mask (bool or uint8) in an array on the simulation's
                device (Warp, torch, anything with ``__dlpack__``), which is not waited for; their :attr:`env_time` is 0
                then. ``None``: all; the time and the step count then start at 0 again, too.
            seed: a whole number s from 0 to 2**63 - 1, of which the first environment that is reset takes s, the next
                s + 1, in the order of the list or the mask; or a list or array of them, one for each that is reset
                (with a mask in an array on the device: one for each environment). From then on an environment counts
                its steps, its time and its resets from here, and its imperfections draw gains, dead taxels, jitter,
                walks and noise from its number alone: it reads the same bytes alone and among thousands, whatever was
                before and whatever seed the scene was built with. Options that you have set since (``set_noise`` ...)
                stay. ``None``: draws continue, and are other ones than before. Points that were sampled on bodies, and
                the wire, the clock and the firmware of devices depend on the seed of the scene only.

        Raises:
            SceneError: an index is out of range; a mask has the wrong length, type or device; a seed is not a whole
                number in range, or there are not as many as environments; the mask is on a GPU, and Python moves
                bodies, which cannot know then whose motion begins; or a graph is captured, and the environments or the
                seeds are not on the device.
        """
        if not self.device.is_cpu and envs is not None and not on_host(envs) and (reason := self._python_moves()):
            raise SceneError(
                f"reset: a mask on the device does not tell Python which environments begin anew, but it computes "
                f"{reason}; give indices, or a mask on the host"
            )
        self._resets.reset(envs, seed)
        if envs is None:
            self.time_ns = self.step_count = self._checked_step = 0
        self._motions.after_reset(envs, self.time_ns)
        for pose in self.posers if envs is None else ():
            pose(self, self._motions.times(self.time_ns))
        self._take_bound()
