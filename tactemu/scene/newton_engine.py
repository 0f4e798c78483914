"""``[engine] kind = "newton"``: many environments of a model that Newton reads, moved by its MuJoCo solver.

::

    scene = tt.Scene(dt=4e-3)
    engine = tt.NewtonEngine(scene, "hand.urdf")
    skin = scene.add_sensor(tt.KinematicTaxel(...), link=engine.source.shape("fingertip"))
    sim = scene.build(4096, device="cuda:0")
    targets = torch.from_dlpack(engine.control.joint_target_q)
    sim.step()

A loop and a solver of one's own: :class:`tactemu.NewtonSource`. Needs the extra ``tactemu[newton]``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.errors import SceneError
from tactemu.scene.batch_engine import BatchEngine
from tactemu.scene.newton_source import NewtonSource

if TYPE_CHECKING:
    import warp as wp

    from tactemu.physics.simulation import Simulation
    from tactemu.scene.engine_tables import NewtonTable
    from tactemu.scene.scene import Scene

TIMESTEP_S = 2e-3
"""Of a model that says none, at most."""


class NewtonEngine(BatchEngine):
    """A model that Newton moves.

    Its shapes that collide are bodies of the scene, under their names.

    Args:
        scene: where they are added.
        file: the model, MJCF (``.xml``) or URDF, or a ``newton.ModelBuilder`` of one environment.
        table: the options.
        timestep: of the solver [s]; default: the largest part of the scene's ``dt`` that is at most 2 ms.

    Raises:
        SceneError: Newton is not installed, or cannot read the file.
    """

    kind = "newton"

    def __init__(
        self, scene: Scene, file: Path | str | Any, table: NewtonTable | None = None, timestep: float | None = None
    ):
        self._newton: Any = self._module("newton", "newton")
        self._module("mujoco_warp", "newton")
        self._builder = self._read(Path(file)) if isinstance(file, str | Path) else file
        if table is not None and table.friction is not None:
            self._builder.shape_material_mu = [table.friction] * len(self._builder.shape_material_mu)
        self._sizes = {} if table is None else table.sizes
        name = Path(file if isinstance(file, str | Path) else "model")
        super().__init__(scene, name, timestep or scene.dt / max(1, int(np.ceil(scene.dt / TIMESTEP_S - 1e-9))))
        self._source = NewtonSource(scene, self._builder.finalize(device="cpu"))
        self.model: Any = None
        """The ``newton.Model`` of the scene that was built last, on its device."""
        self.state: Any = None
        """Its ``newton.State``."""
        self.control: Any = None
        """Its ``newton.Control``: targets and forces of joints are written there."""

    @property
    def source(self) -> NewtonSource:
        """Its shapes and bodies, by their names."""
        return self._source

    def _read(self, file: Path) -> Any:
        builder = self._newton.ModelBuilder()
        self._newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        try:
            if not file.is_file():
                raise OSError("no such file")
            read = builder.add_urdf if file.suffix.lower() == ".urdf" else builder.add_mjcf
            read(str(file))
        except Exception as error:  # whatever its parsers raise
            raise SceneError(f"engine: {file}: Newton cannot read it: {str(error).strip()}") from None
        return builder

    def begin(self, simulation: Simulation) -> _Worlds:
        """As many worlds as the simulation has environments, on its device."""
        worlds = self._newton.ModelBuilder()
        worlds.replicate(self._builder, simulation.n_envs)
        self.model = worlds.finalize(device=str(simulation.device))
        self.state, self.control = self.model.state(), self.model.control()
        self._newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.state)
        solver = self._newton.solvers.SolverMuJoCo(self.model, **self._sizes)
        return _Worlds(self, solver, simulation.n_envs)


class _Worlds:
    """Of one simulation."""

    def __init__(self, engine: NewtonEngine, solver: Any, n_envs: int):
        self._solver, self._state, self._control = solver, engine.state, engine.control
        self._next = engine.model.state()
        self._source, self._steps, self._dt = engine.source, engine.steps, engine.timestep
        self._n_envs = n_envs

    def step(self) -> None:
        now, then = self._state, self._next
        for _ in range(self._steps):
            now.clear_forces()
            self._solver.step(now, then, self._control, None, self._dt)
            now, then = then, now
        if now is not self._state:  # the skins look at one of the two
            self._state.assign(now)

    def arrays(self) -> list[wp.array]:
        state, data = self._state, self._solver.mjw_data
        rows = [state.joint_q, state.joint_qd, state.body_q, state.body_qd, self._control.joint_target_q]
        rows += [self._control.joint_target_qd, self._control.joint_f]
        found = [array.reshape((self._n_envs, -1)) for array in rows if array is not None and array.size]
        return [*found, data.qacc_warmstart, data.time]

    def bind(self, simulation: Simulation) -> None:
        self._source.bind(simulation, self._state)
