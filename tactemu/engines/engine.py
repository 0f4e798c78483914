"""``[engine]`` of a scene file: a simulator that moves the bodies, here MuJoCo. Skins feel its geoms.

Where skins have ``joints``, the loop is closed: at each step the motors of the devices act on the model
(:mod:`tactemu.engines.mujoco_drives`), MuJoCo moves hand and objects, motors learn what became of it, and skins are
pressed as hard as MuJoCo's contacts are (:mod:`tactemu.engines.mujoco_contacts`).
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tactemu.base.errors import PoseError, SceneError, nearest
from tactemu.engines.mujoco_contacts import Contacts, Pad, contacts_of
from tactemu.engines.mujoco_drives import Drive, check_apart
from tactemu.engines.mujoco_source import MujocoSource, check_ranges, load_mujoco
from tactemu.geometry.bodies import Body
from tactemu.scene.engine_tables import MujocoTable

if TYPE_CHECKING:
    from tactemu.scene.engine_registry import JointMotors
    from tactemu.scene.file import LoadedScene
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.simulation import Simulation


_logger = logging.getLogger(__name__)

CATCH_UP_STEPS = 50
"""Steps of the model that one step of the scene waits for at most, unless two of its steps are more ..."""
CATCH_UP_S = 1.0
"""... or, with ``on_late = "drop"``, this much of the model's time [s]."""
BROKEN_DAMPING = 1e3
"""Damping of what is broken, so that it stays where it is."""


def open_engine(scene: Scene, loaded: LoadedScene, motors: Sequence[JointMotors]) -> MujocoEngine:
    """Open the engine of a scene file: see :data:`tactemu.scene.engine_registry.OPENERS`."""
    table = loaded.tables.engine
    assert isinstance(table, MujocoTable)
    drives = [Drive(each.skin, each.device, each.joints, each.local_ns) for each in motors]
    return MujocoEngine(scene, loaded.folder / table.file, drives, table)


class MujocoEngine:
    """A MuJoCo model that runs beside the scene, from its own start and by its own time step.

    Its geoms that take part in collisions are bodies of the scene, under their names. A mocap body of the model goes
    where the body of the scene goes that has its name.

    Args:
        scene: where they are added.
        file: the model, MJCF or URDF.
        drives: motors that move its joints.
        table: the options.

    Raises:
        SceneError: MuJoCo is not installed, or cannot read the file, or a name is not in it.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, file: Path, drives: Sequence[Drive] = (), table: MujocoTable | None = None):
        self._mujoco = load_mujoco()
        if self._mujoco.get_mju_user_warning() is None:  # else MuJoCo writes a file where the user happens to be
            self._mujoco.set_mju_user_warning(_log_mujoco_warning)
        self._table = table or MujocoTable(kind="mujoco", file=str(file))
        self.drives = list(drives)
        check_apart(self.drives)
        self.model = self._read(file)
        check_ranges(self.model, file)
        if not self.model.opt.timestep > 0:
            raise SceneError(f"engine: {file}: timestep is {self.model.opt.timestep:g} s; it must be > 0")
        self.data = self._mujoco.MjData(self.model)
        for drive in self.drives:
            drive.bind(self.model)
        given = {body.name: body for body in scene.bodies}
        self.source = MujocoSource(scene, self.model)
        self.pads: dict[Body, Pad] = {}
        """Skins, by the frames that carry them."""
        self._mocap = [
            (int(self.model.body_mocapid[k]), given[name])
            for k in range(self.model.nbody)
            if self.model.body_mocapid[k] >= 0 and (name := self.model.body(k).name) in given
        ]
        self._breaks = self._breaking_forces()
        kept = (self.model.geom_contype, self.model.geom_conaffinity, self.model.dof_damping)
        self._unbroken = tuple(values.copy() for values in kept)
        if self._table.friction is not None:
            self.model.geom_friction[:, 0] = self._table.friction
            self.model.pair_friction[:, :2] = self._table.friction
        self._left_out_s = 0.0
        """How much later than the clock the model is."""
        scene.posers.append(self.pose)

    def _read(self, file: Path) -> Any:
        mujoco = self._mujoco
        try:
            if not self.drives:
                model = mujoco.MjModel.from_xml_path(str(file))
            else:
                spec = mujoco.MjSpec.from_file(str(file))
                for drive in self.drives:
                    drive.add_to(spec)
                model = spec.compile()
                if model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER:  # it would not damp motors implicitly
                    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        except (ValueError, OSError) as error:
            raise SceneError(f"engine: {file}: {str(error).strip()}") from None
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # what is not finite is said, and ends the run
        return model

    def _breaking_forces(self) -> dict[int, float]:
        known = {name: k for k in self.source.geoms if (name := self.model.geom(k).name)}
        for name in self._table.breaks:
            if name not in known:
                raise SceneError(f"engine: breaks: no geom {name!r}{nearest(name, known)} (geoms: {', '.join(known)})")
        return {known[name]: force for name, force in self._table.breaks.items()}

    @property
    def bodies(self) -> list[Body]:
        """Those that it added to the scene."""
        return self.source.bodies

    @property
    def behind_s(self) -> float:
        """How much later than the clock the model is, because the machine did not keep up [s]."""
        return self._left_out_s

    @property
    def broken(self) -> list[str]:
        """Names of the geoms that broke."""
        return [self.model.geom(geom).name for geom in sorted(self.source.hidden)]

    # -- skins -------------------------------------------------------------------------------------------------------

    def body_of(self, name: str, part: str) -> Body:
        """Return the body that carries a skin on the geom or MuJoCo body of this name: where skins feel its force, a
        frame of the part's own.

        Raises:
            SceneError: there is neither.
        """
        if self._table.felt == "overlap":
            return self.source.body_of(name)
        self.source.check(name)
        frame = self.source.pad(name, part)
        self.pads[frame] = Pad(frame, np.isin(np.arange(self.model.ngeom), self.source.moving_with(name)))
        return frame

    def attach_sensor(self, sensor: Sensor) -> None:
        """A skin was put on a carrier."""
        if sensor.link in self.pads:
            self.pads[sensor.link].attach(sensor)

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the places in the scene of geoms that the skin of a geom or MuJoCo body does not feel."""
        return self.source.ignored_bodies(name)

    # -- each step ---------------------------------------------------------------------------------------------------

    def pose(self, simulation: Simulation, t_s: float) -> None:
        """Run the model up to ``t_s``, from its start where that has passed, and pose its geoms as they are then.

        A loop that is late asks for much at once; what is more than :data:`CATCH_UP_STEPS` is left out, and the model
        goes on from there later than the clock: else it would be later each time.

        Raises:
            PoseError: the model's state is not finite any more.
        """
        dt = self.model.opt.timestep
        if t_s < self.data.time + self._left_out_s - dt / 2:
            self._start_anew()
        steps = round((t_s - self._left_out_s - self.data.time) / dt)
        most = max(CATCH_UP_STEPS, math.ceil(2 * simulation.dt / dt))
        if self._table.on_late == "drop":
            most = max(most, math.ceil(CATCH_UP_S / dt))
        if steps > most:
            if not self._left_out_s:
                _logger.warning("engine: MuJoCo does not keep up with the clock; it runs slower from %.3f s on", t_s)
            self._left_out_s += (steps - most) * dt
        for index, body in self._mocap:
            here = simulation.pose(body)
            self.data.mocap_pos[index], self.data.mocap_quat[index] = here.position, here.quaternion
        for drive in self.drives:
            drive.command(self.model, self.data, t_s, t_s - max(steps, 1) * dt)
        if steps > 0:
            self._mujoco.mj_step(self.model, self.data, min(steps, most))
            self._check(t_s)
        for drive in self.drives:
            drive.report(self.data, t_s)
        if self.pads or self._breaks:
            self._press(contacts_of(self.model, self.data), t_s)
        self.source.update(simulation, self.data)

    def _start_anew(self) -> None:
        self._mujoco.mj_resetData(self.model, self.data)
        self._left_out_s = 0.0
        self._break(())
        for drive in self.drives:
            drive.release()
        for pad in self.pads.values():
            pad.clear()
        self.source.shifts.clear()

    def _check(self, t_s: float) -> None:
        data, model = self.data, self.model
        bad = self._mujoco.mjtWarning
        worst = max(data.warning[kind].number for kind in (bad.mjWARN_BADQPOS, bad.mjWARN_BADQVEL, bad.mjWARN_BADQACC))
        if not worst and np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all():
            return
        with np.errstate(invalid="ignore"):
            wild = ~(np.abs(data.qacc) < 1e10) | ~np.isfinite(data.qvel)
        joints = {model.joint(int(model.dof_jntid[k])).name or "without a name" for k in np.flatnonzero(wild)}
        raise PoseError(
            f"engine: MuJoCo's state is not finite at {t_s:g} s (joints: {', '.join(sorted(joints)) or 'unknown'}): "
            f"the model is unstable at its time step of {model.opt.timestep:g} s; make that smaller, or joints heavier "
            f"(armature) or more damped"
        )

    def _press(self, contacts: Contacts, t_s: float) -> None:
        for geom, limit in self._breaks.items():
            if geom not in self.source.hidden and (force := _largest_contact_force(contacts, geom)) > limit:
                self._break((*self.source.hidden, geom))
                _logger.warning("engine: %s broke under %.2f N at %.3f s", self.model.geom(geom).name, force, t_s)
        for frame, pad in self.pads.items():
            pad.press(contacts, *self.source.place(self.data, frame))
            self.source.shifts[frame] = pad.shift

    def _break(self, broken: Sequence[int]) -> None:
        """Break these geoms, and mend all others: what is broken stays where it is, and nothing touches it."""
        model, hidden = self.model, set(broken)
        if hidden == self.source.hidden:
            return
        model.geom_contype[:], model.geom_conaffinity[:], model.dof_damping[:] = self._unbroken
        for geom in hidden:
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
            body = int(model.geom_bodyid[geom])
            first = int(model.body_dofadr[body])
            dofs = slice(first, first + int(model.body_dofnum[body]))
            model.dof_damping[dofs], self.data.qvel[dofs] = BROKEN_DAMPING, 0.0
        self.source.hidden = hidden

    # -- saving ------------------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """MuJoCo's own, as far as integration depends on it."""
        spec = self._mujoco.mjtState.mjSTATE_INTEGRATION
        values = np.empty(self._mujoco.mj_stateSize(self.model, spec))
        self._mujoco.mj_getState(self.model, self.data, values, spec)
        return {
            "left_out_s": self._left_out_s,
            "values": values,
            "broken": sorted(self.source.hidden),
            "pads": [pad.state() for pad in self.pads.values()],
        }

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """What takes on a state once it is called.

        Raises:
            ValueError: it is not one of this model.
        """
        spec, values, left_out_s = self._mujoco.mjtState.mjSTATE_INTEGRATION, state["values"], state["left_out_s"]
        size = self._mujoco.mj_stateSize(self.model, spec)
        if values.shape != (size,) or values.dtype != np.float64:
            raise ValueError(f"expected {size} numbers of MuJoCo, got {values.shape} {values.dtype}")
        if len(state["pads"]) != len(self.pads):
            raise ValueError(f"expected {len(self.pads)} skins on MuJoCo's bodies, got {len(state['pads'])}")

        def take() -> None:
            self._mujoco.mj_setState(self.model, self.data, values, spec)
            self._left_out_s = float(left_out_s)
            self._break(state["broken"])
            for (frame, pad), each in zip(self.pads.items(), state["pads"]):
                pad.take(each)
                self.source.shifts[frame] = pad.shift

        return take


def _log_mujoco_warning(text: str) -> None:
    """What MuJoCo warns of; what matters ends the run and is said then."""
    _logger.debug("engine: MuJoCo: %s", text)


def _largest_contact_force(contacts: Contacts, geom: int) -> float:
    """Return the force of the geom that presses another hardest [N]."""
    mine = contacts.geoms == geom
    touching = mine.any(axis=1)
    others = np.where(mine[touching, 0], contacts.geoms[touching, 1], contacts.geoms[touching, 0])
    forces = contacts.forces[touching]
    return max((float(forces[others == other].sum()) for other in np.unique(others)), default=0.0)
