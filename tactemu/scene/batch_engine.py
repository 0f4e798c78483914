"""A simulator that moves many environments on the simulation's own device, as a stage of its plan.

It steps first in each step of the simulation, then its poses are taken, so all of it is one graph on a GPU. Nothing is
pressed by its contact forces: skins feel how deep its geoms overlap, as with ``felt = "overlap"`` of MuJoCo's engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from tactemu.errors import SceneError
from tactemu.plan.clearing import restore_rows
from tactemu.plan.plan import Stage

if TYPE_CHECKING:
    import warp as wp

    from tactemu.physics.sensor import Sensor
    from tactemu.physics.simulation import Simulation
    from tactemu.scene.bodies import Body
    from tactemu.scene.scene import Scene


class Worlds(Protocol):
    """The environments of one simulation within another simulator."""

    def step(self) -> None:
        """Move all by the engine's ``steps``, and leave poses and velocities as they are then. Allocates nothing."""

    def arrays(self) -> Sequence[wp.array]:
        """What lasts from step to step; the first axis is of the environments."""
        ...

    def bind(self, simulation: Simulation) -> None:
        """Have the simulation take the poses at each step, from now on."""


class Source(Protocol):
    """The bodies that an engine added to the scene."""

    @property
    def bodies(self) -> list[Body]:
        """All of them."""
        ...

    def carrier(self, name: str) -> Body:
        """The body that carries a skin on a geom or body of this name."""
        ...

    def unfelt(self, name: str) -> tuple[int, ...]:
        """The places in the scene of what such a skin does not feel."""
        ...


class BatchEngine:
    """What :class:`~tactemu.scene.mujoco_warp_engine.MujocoWarpEngine` and
    :class:`~tactemu.scene.newton_engine.NewtonEngine` have in common.

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

    def __init__(self, scene: Scene, file: Path, timestep: float):
        self.file = file
        self.steps = round(scene.dt / timestep)
        """Of the model, in each step of the scene."""
        if self.steps < 1 or abs(self.steps * timestep - scene.dt) > 1e-6 * timestep:
            raise SceneError(
                f"engine: {file.name} has a time step of {timestep:g} s, the scene's dt is {scene.dt:g} s; make dt a "
                "multiple of it"
            )
        self.timestep = timestep
        scene.planners.append(self._join)

    @property
    def source(self) -> Source:
        """The bodies that it added."""
        raise NotImplementedError

    def begin(self, simulation: Simulation) -> Worlds:
        """As many environments of the model as the simulation has, at their start, on its device."""
        raise NotImplementedError

    def _join(self, simulation: Simulation) -> None:
        import warp as wp

        with wp.ScopedDevice(simulation.device):
            worlds = self.begin(simulation)
            worlds.bind(simulation)
            arrays = worlds.arrays()
            starts = [wp.clone(array) for array in arrays]
        simulation.context.memory.extend(arrays)

        def step() -> None:
            with wp.ScopedDevice(simulation.device):
                worlds.step()

        def reset(mask: wp.array) -> None:
            for array, start in zip(arrays, starts):
                restore_rows(array, start, mask)

        reason = f"{self.file.name}: {self.steps} steps of {1e3 * self.timestep:g} ms in each"
        simulation.plan.insert(Stage(name=self.kind, reason=reason, launch=step, reset=reset), before="bound poses")

    # -- what a scene file asks for ----------------------------------------------------------------------------------

    @property
    def bodies(self) -> list[Body]:
        """Those that it added to the scene."""
        return self.source.bodies

    def carrier(self, name: str, _part: str) -> Body:
        """The body that carries a skin on the geom or body of this name.

        Raises:
            SceneError: there is neither.
        """
        return self.source.carrier(name)

    def carries(self, sensor: Sensor) -> None:
        """A skin was put on a carrier."""

    def unfelt(self, name: str) -> tuple[int, ...]:
        """The places in the scene of what the skin of a geom or body does not feel."""
        return self.source.unfelt(name)

    # -- reading a model ---------------------------------------------------------------------------------------------

    @staticmethod
    def _module(name: str, extra: str) -> Any:
        """An optional package.

        Raises:
            SceneError: it is not installed.
        """
        import importlib

        try:
            return importlib.import_module(name)
        except ImportError as error:
            raise SceneError(f"{name} cannot be imported ({error}): pip install 'tactemu[{extra}]'") from None
