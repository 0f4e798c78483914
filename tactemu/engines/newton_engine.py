"""The engine ``newton`` of a scene file: many environments of a model that Newton's MuJoCo solver moves.

::

    scene = tt.Scene(dt=4e-3)
    engine = tt.NewtonEngine(scene, "hand.urdf")
    skin = scene.add_sensor(tt.KinematicTaxel(...), link=engine.source.shape("fingertip"))
    sim = scene.build(4096, device="cuda:0")
    targets = torch.from_dlpack(engine.control.joint_target_q)
    sim.step()

For a loop and a solver of your own use :class:`tactemu.NewtonSource`. It needs the extra ``tactemu[newton]``.
"""

# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.engines.batch_engine import BatchEngine
from tactemu.engines.newton_source import NewtonSource
from tactemu.scene.engine_tables import NewtonTable

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation

TIMESTEP_S = 2e-3
"""The largest time step of a model that gives none."""
STATE = "time", "act", "history", "qacc_warmstart"
"""The solver's own arrays that are part of the state."""


class NewtonEngine(BatchEngine):
    """A model that Newton moves.

    Its shapes that collide are bodies of the scene, under their names.

    Args:
        scene: the scene to which the shapes are added.
        file: the model, MJCF (``.xml``) or URDF, or a ``newton.ModelBuilder`` of one environment.
        table: the options.
        timestep: time step of the solver [s]; default: the file's (``<option timestep=...>``); if it gives none, the
            largest fraction of the scene's ``dt`` that is at most 2 ms.

    Raises:
        SceneError: Newton is not installed, cannot read the file, or ``dt`` is no multiple of the time step.
    """

    kind = "newton"
    scalar_last = True

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
        if timestep is None and isinstance(file, str | Path):
            timestep = _timestep(Path(file))
        if timestep is None:
            timestep = scene.dt / max(1, int(np.ceil(scene.dt / TIMESTEP_S - 1e-9)))
        super().__init__(scene, name, timestep)
        self._source = NewtonSource(scene, self._builder.finalize(device="cpu"))
        self.model: Any = None
        """The ``newton.Model`` of the scene that was built last, on its device."""
        self.state: Any = None
        """The model's ``newton.State``."""
        self.control: Any = None
        """The model's ``newton.Control``: ``joint_target_q`` has the targets of position servos, in the order of
        :attr:`positions`; ``mujoco.ctrl`` has the commands of other actuators of an MJCF file, in its order."""
        self.solver: Any = None
        """The model's ``newton.solvers.SolverMuJoCo``."""

    @property
    def source(self) -> NewtonSource:
        """The model's shapes and bodies, by their names."""
        return self._source

    @property
    def start(self) -> np.ndarray:
        """A row of ``joint_q`` at the model's start."""
        return np.asarray(self._builder.joint_q, np.float64)

    def _read(self, file: Path) -> Any:
        builder = self._newton.ModelBuilder()
        # Otherwise pairs up to 0.1 m apart, none of which MuJoCo uses, would fill the capacity for contacts.
        builder.rigid_gap = 0.0
        self._newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        try:
            if not file.is_file():
                raise OSError("no such file")
            read = builder.add_urdf if file.suffix.lower() == ".urdf" else builder.add_mjcf
            read(str(file))
        except Exception as error:  # Newton's parsers may raise anything
            raise SceneError(f"engine: {file}: Newton cannot read it: {str(error).strip()}") from None
        _check_ranges(builder, file)
        return builder

    def create_worlds(self, simulation: Simulation) -> _Worlds:
        """Create as many worlds as the simulation has environments, on its device."""
        worlds = self._newton.ModelBuilder()
        worlds.replicate(self._builder, simulation.n_envs)
        self.model = worlds.finalize(device=str(simulation.device))
        self.state, self.control = self.model.state(), self.model.control()
        self.solver = self._newton.solvers.SolverMuJoCo(self.model, **self._sizes)
        self.solver.mjw_model.opt.warn_overflow = 0  # BatchEngine warns instead, and once only
        return _Worlds(self, self._newton, simulation.n_envs)


def _check_ranges(builder: Any, file: Path) -> None:
    """Check that no joint's range is reversed.

    Raises:
        SceneError: a range is reversed; the message names the joint.
    """
    for k, (low, high) in enumerate(zip(builder.joint_limit_lower, builder.joint_limit_upper)):
        if low > high:
            name = builder.joint_label[bisect_right(builder.joint_qd_start, k) - 1].rpartition("/")[2]
            raise SceneError(
                f"engine: {file}: joint {name!r}: range is from {low:g} to {high:g}; give the lower end first"
            )


def _timestep(file: Path) -> float | None:
    """Return the time step of an MJCF file and its includes [s], which Newton does not read, or None.

    Raises:
        SceneError: the time step is no number.
    """
    if file.suffix.lower() == ".urdf":
        return None
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError):
        return None
    given = [each.get("timestep") for each in root.iter("option") if each.get("timestep")]
    try:
        found = [float(text) for text in given if text]
    except ValueError:
        raise SceneError(f"engine: {file}: timestep must be a number, got {given[-1]!r:.40}") from None
    found += [
        step for each in root.iter("include") if (step := _timestep(file.parent / each.get("file", ""))) is not None
    ]
    return found[-1] if found else None


@warp_kernel
def remember(now: wp.array(dtype=wp.int32), so_far: wp.array(dtype=wp.int32)):
    """Collect flags that the solver clears at its next step."""
    e = wp.tid()
    so_far[e] = so_far[e] | now[e]


class _Worlds:
    """The worlds of one simulation."""

    def __init__(self, engine: NewtonEngine, newton: Any, n_envs: int):
        self._newton, self._model, self._solver = newton, engine.model, engine.solver
        self._state, self._control = engine.state, engine.control
        self._next = engine.model.state()
        self.data = engine.solver.mjw_data
        self.overflow = wp.zeros(n_envs, dtype=wp.int32)
        self._source, self._steps, self._dt = engine.source, engine.steps, engine.timestep
        self._n_envs = n_envs

    def step(self) -> None:
        now, then = self._state, self._next
        for _ in range(self._steps):
            now.clear_forces()
            self._solver.step(now, then, self._control, None, self._dt)
            wp.launch(remember, dim=self._n_envs, inputs=[self.data.overflow], outputs=[self.overflow])
            now, then = then, now
        if now is not self._state:  # the skins read this one of the two
            self._state.assign(now)

    def refresh(self) -> None:
        """Do nothing: poses and velocities are among the arrays."""

    def arrays(self) -> list[wp.array]:
        state, control, data = self._state, self._control, self.data
        rows = [state.joint_q, state.joint_qd, state.body_q, state.body_qd, control.joint_target_q]
        rows += [control.joint_target_qd, control.joint_f, getattr(getattr(control, "mujoco", None), "ctrl", None)]
        found = [array.reshape((self._n_envs, -1)) for array in rows if array is not None and array.size]
        own = [array for name in STATE if (array := getattr(data, name, None)) is not None and array.size]
        return [*found, *own]

    @property
    def positions(self) -> wp.array:
        return self._state.joint_q.reshape((self._n_envs, -1))

    def bind(self, simulation: Simulation) -> None:
        state = self._state
        self._newton.eval_fk(self._model, state.joint_q, state.joint_qd, state)
        self._source.bind(simulation, state)


open_engine = NewtonEngine.from_file
"""Open the engine of a scene file: see :attr:`tactemu.scene.engine_tables.ModelTable.opener`."""
