"""The base of engines that move many environments on the simulation's own device, as a stage of its plan.

In each step of the simulation the engine steps first and its poses are then read, so that all is one graph on a GPU.
Skins do not use its contact forces: they measure how deep its geoms overlap, as with MuJoCo's ``felt = "overlap"``.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from tactemu.base.errors import SceneError, no_such
from tactemu.base.kernels import start_warp
from tactemu.plan.clearing import restore_rows
from tactemu.plan.plan import Stage

if TYPE_CHECKING:
    import warp as wp

    from tactemu.geometry.bodies import Body
    from tactemu.scene.engine_interface import JointMotors
    from tactemu.scene.engine_tables import BatchTable
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
        """Step all environments by the engine's ``steps`` and update poses and velocities, without allocating."""

    def refresh(self) -> None:
        """Update poses and velocities from the positions, without a step and without allocating."""
        ...

    def arrays(self) -> Sequence[wp.array]:
        """Return the arrays of the state; their first axis is that of the environments."""
        ...

    @property
    def positions(self) -> wp.array:
        """The positions of all joints, ``(n_envs, n)``, which the steps update."""
        ...

    @property
    def data(self) -> Any:
        """The ``mujoco_warp.Data`` of all environments."""
        ...

    @property
    def overflow(self) -> wp.array:
        """The overflows of each environment so far, flags of ``mujoco_warp.OverflowType``, ``(n_envs,)``."""
        ...

    def bind(self, simulation: Simulation) -> None:
        """Bind the simulation's poses to these environments, and update them from the positions."""


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
        """Return the indices of the scene's bodies that such a skin ignores."""
        ...

    @property
    def free_bodies(self) -> dict[str, int]:
        """The index of each free body's first of 7 numbers in a row of positions, by the body's name."""
        ...

    def column(self, name: str) -> int:
        """Return the index of the first number of a joint, or of a free body, in a row of positions."""
        ...

    def root(self, name: str) -> str:
        """Return the name of the root body under a geom or body of this name."""
        ...


class BatchEngine(ABC):
    """The base class of :class:`~tactemu.engines.mujoco_warp_engine.MujocoWarpEngine` and
    :class:`~tactemu.engines.newton_engine.NewtonEngine`.

    Each step of the simulation is :attr:`steps` steps of the engine, whatever its ``dt``: in a live loop that is late
    the model lags behind the clock. :meth:`tactemu.Simulation.reset` also resets the model's environments.

    Args:
        scene: the scene whose bodies the engine moves.
        file: the model's file, for messages.
        timestep: the model's time step [s]; the scene's ``dt`` must be a multiple of it.

    Raises:
        SceneError: ``dt`` is no multiple of the time step.
    """

    kind: ClassVar[str]
    """The ``kind`` in a scene file."""
    behind_s: ClassVar[float] = 0.0
    """The lag of the model behind the clock [s]."""
    scalar_last: ClassVar[bool] = False
    """True if w is the last number of a quaternion among the positions."""

    @classmethod
    def from_file(cls, table: BatchTable, scene: Scene, folder: Path, _motors: Sequence[JointMotors]) -> Self:
        """Return the engine of a scene file, whose bodies it adds to the scene.

        Raises:
            SceneError: the engine cannot read its model.
        """
        made: Any = cls  # a subclass takes the table, and not a time step
        return made(scene, folder / table.file, table)

    def __init__(self, scene: Scene, file: Path, timestep: float):
        self.file = file
        if not timestep > 0:
            raise SceneError(f"engine: {file.name} has a time step of {timestep:g} s; it must be > 0")
        self.steps = round(scene.dt / timestep)
        """The number of the model's steps in each step of the scene."""
        if self.steps < 1 or abs(self.steps * timestep - scene.dt) > 1e-6 * timestep:
            raise SceneError(
                f"engine: {file.name} has a time step of {timestep:g} s, the scene's dt is {scene.dt:g} s; make dt a "
                "multiple of it"
            )
        self.timestep = timestep
        self.starts: Mapping[str, tuple[np.ndarray, np.ndarray]] = {}
        """Start poses of free bodies, by name, for scenes that are built from now on: position [m] and quaternion
        (w, x, y, z), with a row for each environment by its index; default: those of the model."""
        self.positions: Any = None
        """Positions of all joints of the scene that was built last, a Warp array ``(n_envs, n)`` on its device, in the
        engine's order: ``source.column(joint)`` is the index at which each begins."""
        scene.planners.append(self._add_stage)

    @property
    @abstractmethod
    def source(self) -> BodySource:
        """The bodies of the model that are in the scene."""

    @abstractmethod
    def create_worlds(self, simulation: Simulation) -> Worlds:
        """Create as many environments of the model as the simulation has, at their start, on its device."""

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
        """Return a function that warns, once, if contacts or constraints are left out for lack of capacity."""
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
                    "engine: %s: there are more %s than the capacity, and some are left out; first in environment "
                    "%s: increase `%s` in [engine] (the capacity is %d in each environment)",
                    self.file.name, what, ", ".join(map(str, envs[:5])), option, room[option],
                )  # fmt: skip

        return check

    def start_of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return position [m] and quaternion (w, x, y, z) at which a free body of the model starts.

        Raises:
            SceneError: there is no free body of this name.
        """
        first = self._free(name)
        row = self.start[first : first + 7]
        return row[:3], np.roll(row[3:], 1) if self.scalar_last else row[3:]

    @property
    @abstractmethod
    def start(self) -> np.ndarray:
        """A row of positions at the model's start."""

    def _free(self, name: str) -> int:
        free = self.source.free_bodies
        if name not in free:
            raise SceneError(f"engine: {no_such('free body', name, free, 'free bodies')}")
        return free[name]

    def _place_bodies(self, simulation: Simulation) -> None:
        """Put free bodies at the start poses of their environments."""
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
                    f"engine: start poses of {name!r}: expected shapes (n, 3) and (n, 4) for the environments up to "
                    f"{mine.stop - 1}, got {got}"
                )
            if self.scalar_last:
                quaternion = np.roll(quaternion, -1, axis=1)
            rows[:, first : first + 7] = np.concatenate([position, quaternion], axis=1)
        if not simulation.device.is_cpu:
            self.positions.assign(rows)

    # -- the interface for scene files -------------------------------------------------------------------------------

    @property
    def bodies(self) -> list[Body]:
        """The bodies that it added to the scene."""
        return self.source.bodies

    def body_of(self, name: str, _part: str) -> Body:
        """Return the body that carries a skin on the geom or body of this name.

        Raises:
            SceneError: there is neither a geom nor a body of this name.
        """
        return self.source.body_of(name)

    def attach_sensor(self, sensor: Sensor) -> None:
        """Do nothing: skins follow the poses of their bodies."""

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on this geom or body ignores."""
        return self.source.ignored_bodies(name)

    # -- reading a model ---------------------------------------------------------------------------------------------

    @staticmethod
    def _module(name: str, extra: str) -> Any:
        """Return an optional package; one that starts Warp finds it running, without messages.

        Raises:
            SceneError: it is not installed.
        """
        import importlib

        start_warp()
        try:
            return importlib.import_module(name)
        except ImportError as error:
            raise SceneError(f"{name} cannot be imported ({error}): pip install 'tactemu[{extra}]'") from None
