"""A simulator that moves many environments on the simulation's own device, as a stage of its plan.

It steps first in each step of the simulation, then its poses are taken, so all of it is one graph on a GPU. Nothing is
pressed by its contact forces: skins feel how deep its geoms overlap, as with ``felt = "overlap"`` of MuJoCo's engine.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from tactemu.base.errors import SceneError, nearest
from tactemu.plan.clearing import restore_rows
from tactemu.plan.plan import Stage

if TYPE_CHECKING:
    import warp as wp

    from tactemu.geometry.bodies import Body
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.simulation import Simulation


_logger = logging.getLogger(__name__)

CAPACITIES = {
    "nconmax": ("contacts", "BROADPHASE", "NARROWPHASE", "CCD"),
    "njmax": ("constraints", "NEFC", "NJMAX_NNZ"),
}
"""The quantity that each capacity option counts, and the ``mujoco_warp.OverflowType`` flags of its overflow."""


class Worlds(Protocol):
    """The environments of one simulation within another simulator."""

    def step(self) -> None:
        """Move all by the engine's ``steps``, and leave poses and velocities as they are then. Allocates nothing."""

    def refresh(self) -> None:
        """Leave poses and velocities as the positions are, without a step. Allocates nothing."""
        ...

    def arrays(self) -> Sequence[wp.array]:
        """What lasts from step to step; the first axis is of the environments."""
        ...

    @property
    def positions(self) -> wp.array:
        """Of all joints, ``(n_envs, n)``, where the steps have them."""
        ...

    @property
    def data(self) -> Any:
        """The ``mujoco_warp.Data`` of all environments."""
        ...

    @property
    def overflow(self) -> wp.array:
        """For what there was no room in each environment so far, ``(n_envs,)``: ``mujoco_warp.OverflowType``."""
        ...

    def bind(self, simulation: Simulation) -> None:
        """Have the simulation take the poses at each step, from now on, and now as the positions are."""


class BodySource(Protocol):
    """The bodies that an engine added to the scene."""

    @property
    def bodies(self) -> list[Body]:
        """All of them."""
        ...

    def body_of(self, name: str) -> Body:
        """Return the body that carries a skin on a geom or body of this name."""
        ...

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the places in the scene of what such a skin does not feel."""
        ...

    @property
    def free_bodies(self) -> dict[str, int]:
        """Bodies of the model that move freely, by name: where their 7 numbers begin in a row of positions."""
        ...

    def column(self, name: str) -> int:
        """Where the numbers of a joint, or of a body that moves freely, begin in a row of positions."""
        ...

    def root(self, name: str) -> str:
        """Return the body of the model that carries a geom or body of this name, and is carried by none itself."""
        ...


class BatchEngine(ABC):
    """What :class:`~tactemu.engines.mujoco_warp_engine.MujocoWarpEngine` and
    :class:`~tactemu.engines.newton_engine.NewtonEngine` have in common.

    Each step of the simulation is :attr:`steps` of the engine's, whatever ``dt`` it is told: a live loop that is late
    leaves the model behind the clock. :meth:`tactemu.Simulation.reset` resets the model's environments too.

    Args:
        scene: what it moves.
        file: of the model, for messages.
        timestep: of the model [s]; the scene's ``dt`` is a multiple of it.

    Raises:
        SceneError: ``dt`` is no multiple of the time step.
    """

    kind: ClassVar[str]
    behind_s: ClassVar[float] = 0.0
    scalar_last: ClassVar[bool] = False
    """Is w the last number of a quaternion among the positions?"""

    def __init__(self, scene: Scene, file: Path, timestep: float):
        self.file = file
        if not timestep > 0:
            raise SceneError(f"engine: {file.name} has a time step of {timestep:g} s; it must be > 0")
        self.steps = round(scene.dt / timestep)
        """Of the model, in each step of the scene."""
        if self.steps < 1 or abs(self.steps * timestep - scene.dt) > 1e-6 * timestep:
            raise SceneError(
                f"engine: {file.name} has a time step of {timestep:g} s, the scene's dt is {scene.dt:g} s; make dt a "
                "multiple of it"
            )
        self.timestep = timestep
        self.starts: Mapping[str, tuple[np.ndarray, np.ndarray]] = {}
        """Where bodies that move freely start, by name, in the scenes that are built from now on: position [m] and
        quaternion (w, x, y, z), a row for each environment by its number; default: as the model says."""
        self.positions: Any = None
        """Of all joints of the scene that was built last, a Warp array ``(n_envs, n)`` on its device, as the engine has
        them: ``source.column(joint)`` says where each begins."""
        scene.planners.append(self._add_stage)

    @property
    @abstractmethod
    def source(self) -> BodySource:
        """The bodies that it added."""

    @abstractmethod
    def create_worlds(self, simulation: Simulation) -> Worlds:
        """As many environments of the model as the simulation has, at their start, on its device."""

    def _add_stage(self, simulation: Simulation) -> None:
        import warp as wp

        with wp.ScopedDevice(simulation.device):
            worlds = self.create_worlds(simulation)
            self.positions = worlds.positions
            self._place_bodies(simulation)
            worlds.bind(simulation)
            arrays = worlds.arrays()
            starts = [wp.clone(array) for array in arrays]
        simulation.context.memory.extend(arrays)
        check = self._overflow_check(worlds, simulation.context.first_env)

        def step() -> None:
            with wp.ScopedDevice(simulation.device):
                worlds.step()
            if simulation.device.is_cpu:
                check()

        def reset(mask: wp.array) -> None:
            for array, start in zip(arrays, starts):
                restore_rows(array, start, mask)
            with wp.ScopedDevice(simulation.device):
                worlds.refresh()

        reason = f"{self.file.name}: {self.steps} steps of {1e3 * self.timestep:g} ms in each"
        stage = Stage(name=self.kind, reason=reason, launch=step, reset=reset, check=check)
        simulation.plan.insert(stage, before="bound poses")

    def _overflow_check(self, worlds: Worlds, first_env: int) -> Callable[[], None]:
        """What warns, once, where contacts or constraints are left out because there is no room for them."""
        flags = self._module("mujoco_warp", self.kind).OverflowType
        data, left = worlds.data, dict(CAPACITIES)
        room = {"nconmax": data.naconmax // data.nworld, "njmax": data.njmax}

        def check() -> None:
            overflow = worlds.overflow.numpy()
            for option, (what, *names) in [*left.items()] if overflow.any() else ():
                envs = first_env + np.flatnonzero(overflow & sum(flags[name] for name in names))
                if not len(envs):
                    continue
                del left[option]
                _logger.warning(
                    "engine: %s: more %s at once than there is room for, and some are left out; first in environment "
                    "%s: give more `%s` in [engine] (there is room for %d in each environment)",
                    self.file.name, what, ", ".join(map(str, envs[:5])), option, room[option],
                )  # fmt: skip

        return check

    def start_of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Where the model has a body that moves freely start: position [m] and quaternion (w, x, y, z).

        Raises:
            SceneError: there is none of this name.
        """
        first = self._free(name)
        row = self.start[first : first + 7]
        return row[:3], np.roll(row[3:], 1) if self.scalar_last else row[3:]

    @property
    @abstractmethod
    def start(self) -> np.ndarray:
        """A row of positions as the model has them at its start."""

    def _free(self, name: str) -> int:
        free = self.source.free_bodies
        if name not in free:
            known = ", ".join(free) or "none"
            raise SceneError(f"engine: {name!r} is no body that moves freely{nearest(name, free)} (there are: {known})")
        return free[name]

    def _place_bodies(self, simulation: Simulation) -> None:
        """Put bodies where their environments have them start."""
        if not self.starts:
            return
        mine = slice(simulation.context.first_env, simulation.context.first_env + simulation.n_envs)
        rows = self.positions.numpy()
        for name, given in self.starts.items():
            first = self._free(name)
            position, quaternion = (np.asarray(each, np.float64)[mine] for each in given)
            if position.shape != (simulation.n_envs, 3) or quaternion.shape != (simulation.n_envs, 4):
                got = " and ".join(str(np.shape(each)) for each in given)
                raise SceneError(
                    f"engine: where {name!r} starts: expected (n, 3) and (n, 4) for the environments up to "
                    f"{mine.stop - 1}, got {got}"
                )
            if self.scalar_last:
                quaternion = np.roll(quaternion, -1, axis=1)
            rows[:, first : first + 7] = np.concatenate([position, quaternion], axis=1)
        if not simulation.device.is_cpu:
            self.positions.assign(rows)

    # -- what a scene file asks for ----------------------------------------------------------------------------------

    @property
    def bodies(self) -> list[Body]:
        """Those that it added to the scene."""
        return self.source.bodies

    def body_of(self, name: str, _part: str) -> Body:
        """Return the body that carries a skin on the geom or body of this name.

        Raises:
            SceneError: there is neither.
        """
        return self.source.body_of(name)

    def attach_sensor(self, sensor: Sensor) -> None:
        """A skin was put on a carrier."""

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the places in the scene of what the skin of a geom or body does not feel."""
        return self.source.ignored_bodies(name)

    # -- reading a model ---------------------------------------------------------------------------------------------

    @staticmethod
    def _module(name: str, extra: str) -> Any:
        """Return an optional package.

        Raises:
            SceneError: it is not installed.
        """
        import importlib

        try:
            return importlib.import_module(name)
        except ImportError as error:
            raise SceneError(f"{name} cannot be imported ({error}): pip install 'tactemu[{extra}]'") from None
