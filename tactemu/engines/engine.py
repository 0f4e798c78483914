"""The engine ``mujoco`` of a scene file: MuJoCo moves the bodies, and skins touch its geoms.

Where skins have ``joints``, the loop is closed: at each step the motors of the devices act on the model
(:mod:`tactemu.engines.mujoco_drives`), MuJoCo moves hand and objects, the motors receive the resulting positions and
forces, and skins are pressed as hard as MuJoCo's contacts are (:mod:`tactemu.engines.mujoco_contacts`).
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

from tactemu.base.errors import PoseError, SceneError, no_such
from tactemu.engines.mujoco_contacts import REACH_RADII, Contacts, Pad, closing_speeds, contacts_of, mean_contacts
from tactemu.engines.mujoco_drives import Drive, check_apart
from tactemu.engines.mujoco_impacts import match_reason
from tactemu.engines.mujoco_source import MujocoSource, check_ranges, load_mujoco
from tactemu.geometry.bodies import Body
from tactemu.scene.engine_tables import MujocoTable

if TYPE_CHECKING:
    from tactemu.scene.engine_interface import JointMotors
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.simulation import Simulation


_logger = logging.getLogger(__name__)

CATCH_UP_STEPS = 50
"""The most steps of the model in one step of the scene, unless two steps of the scene are more ..."""
CATCH_UP_S = 1.0
"""... or, with ``on_late = "drop"``, this much of the model's time is."""
BROKEN_DAMPING = 1e3
"""The damping of a broken geom's joints, so that it stays where it is."""


def open_engine(table: MujocoTable, scene: Scene, folder: Path, motors: Sequence[JointMotors]) -> MujocoEngine:
    """Open the engine of a scene file: see :attr:`tactemu.scene.engine_tables.ModelTable.opener`."""
    drives = [Drive(each.skin, each.device, each.joints, each.local_ns) for each in motors]
    return MujocoEngine(scene, folder / table.file, drives, table)


class MujocoEngine:
    """A MuJoCo model that runs beside the scene, from its own start and by its own time step.

    Its geoms that take part in collisions are bodies of the scene, under their names. A mocap body of the model follows
    the body of the scene that has the same name.

    Args:
        scene: the scene to which the geoms are added.
        file: the model, MJCF or URDF.
        drives: motors that move its joints.
        table: the options.

    Raises:
        SceneError: MuJoCo is not installed or cannot read the file, or the model lacks a name.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, file: Path, drives: Sequence[Drive] = (), table: MujocoTable | None = None):
        self._mujoco = load_mujoco()
        if self._mujoco.get_mju_user_warning() is None:  # else MuJoCo writes a log file into the working directory
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
        self._scene_dt, self._knows_all = scene.dt, not any(body.shape for body in scene.bodies)
        """The scene's step [s], and whether all that may press on a skin is MuJoCo's."""
        self.source = MujocoSource(scene, self.model)
        self.pads: dict[Body, Pad] = {}
        """The skins whose forces follow MuJoCo's contacts, by the frames that carry them."""
        self._pad_geoms = np.zeros(self.model.ngeom, bool)
        """A mask of the geoms that move with any of them."""
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
        """The lag of the model behind the clock."""
        self.beside_ns = 0.0
        """The impulse of contacts on geoms with skins, but beside all of their taxels, since the start [N s]."""
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
                if (
                    model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
                ):  # Euler would not integrate the motors' damping implicitly
                    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        except (ValueError, OSError) as error:
            raise SceneError(f"engine: {file}: {str(error).strip()}") from None
        model.opt.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_AUTORESET
        )  # a state that is not finite must end the run with a message
        return model

    def _breaking_forces(self) -> dict[int, float]:
        known = {name: k for k in self.source.geoms if (name := self.model.geom(k).name)}
        for name in self._table.breaks:
            if name not in known:
                raise SceneError(f"engine: breaks: {no_such('geom', name, known)}")
        return {known[name]: force for name, force in self._table.breaks.items()}

    @property
    def bodies(self) -> list[Body]:
        """The bodies that it added to the scene."""
        return self.source.bodies

    @property
    def behind_s(self) -> float:
        """The lag of the model behind the clock, because the machine did not keep up [s]."""
        return self._left_out_s

    @property
    def broken(self) -> list[str]:
        """Names of the geoms that broke."""
        return [self.model.geom(geom).name for geom in sorted(self.source.hidden)]

    # -- skins -------------------------------------------------------------------------------------------------------

    def body_of(self, name: str, part: str) -> Body:
        """Return the body that carries a skin on the geom or MuJoCo body of this name.

        Unless skins measure overlap, it is a frame of the part's own.

        Raises:
            SceneError: there is neither a geom nor a body of this name.
        """
        if self._table.felt == "overlap":
            return self.source.body_of(name)
        self.source.check(name)
        frame = self.source.pad(name, part)
        geoms = np.isin(np.arange(self.model.ngeom), self.source.moving_with(name))
        self.pads[frame], self._pad_geoms = Pad(frame, geoms), self._pad_geoms | geoms
        return frame

    def attach_sensor(self, sensor: Sensor) -> None:
        """Register a sensor on one of its bodies."""
        if (pad := self.pads.get(sensor.link)) is not None:
            knows_all = self._knows_all and pad.geoms.any()
            touch = self.source.may_touch
            pad.attach(sensor, match_reason(self.model, pad.geoms, touch, self._scene_dt) if knows_all else None)

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on this geom or MuJoCo body ignores."""
        return self.source.ignored_bodies(name)

    # -- each step ---------------------------------------------------------------------------------------------------

    def pose(self, simulation: Simulation, t_s: float) -> None:
        """Run the model up to ``t_s`` and pose its geoms; restart the model if ``t_s`` lies before its time.

        A late loop needs many steps at once. Steps beyond :data:`CATCH_UP_STEPS` are left out, and the model then lags
        behind the clock: otherwise it would be later each time.

        Raises:
            PoseError: the model's state is no longer finite.
        """
        if simulation.batched:  # one model for all environments
            t_s = simulation.time
        dt = self.model.opt.timestep
        if t_s < self.data.time + self._left_out_s - dt / 2:
            self._restart()
        steps = round((t_s - self._left_out_s - self.data.time) / dt)
        most = max(CATCH_UP_STEPS, math.ceil(2 * simulation.dt / dt))
        if self._table.on_late == "drop":
            most = max(most, math.ceil(CATCH_UP_S / dt))
        if steps > most:
            if not self._left_out_s:
                _logger.warning("engine: MuJoCo does not keep up with the clock; it lags behind from %.3f s on", t_s)
            self._left_out_s += (steps - most) * dt
        for index, body in self._mocap:
            here = simulation.pose(body)
            self.data.mocap_pos[index], self.data.mocap_quat[index] = here.position, here.quaternion
        for drive in self.drives:
            drive.command(self.model, self.data, t_s, t_s - max(steps, 1) * dt)
        contacts: list[Contacts] = []
        if steps > 0:
            steps = min(steps, most)
            if steps > 1 and self.pads:  # a contact that begins and ends within the step has its part in the mean
                for _ in range(steps - 1):
                    self._mujoco.mj_step(self.model, self.data)
                    contacts.append(contacts_of(self.model, self.data, self._pad_geoms))
                steps = 1
            self._mujoco.mj_step(self.model, self.data, steps)
            self._check(t_s)
        for drive in self.drives:
            drive.report(self.data, t_s)
        if self.pads or self._breaks:
            contacts.append(contacts_of(self.model, self.data, None if self._breaks else self._pad_geoms))
            self._press(contacts, t_s)
        self.source.update(simulation, self.data)

    def _restart(self) -> None:
        self._mujoco.mj_resetData(self.model, self.data)
        self._left_out_s = self.beside_ns = 0.0
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
            f"the model is unstable at its time step of {model.opt.timestep:g} s; make that smaller, or give joints "
            f"more armature or damping"
        )

    def _press(self, steps: Sequence[Contacts], t_s: float) -> None:
        """Break geoms, and press the skins, by the contacts of each step of the model since the last call."""
        for geom, limit in self._breaks.items():
            if geom not in self.source.hidden and (force := _largest_contact_force(steps[-1], geom)) > limit:
                self._break((*self.source.hidden, geom))
                _logger.warning("engine: %s broke under %.2f N at %.3f s", self.model.geom(geom).name, force, t_s)
        if not self.pads:
            return
        contacts = mean_contacts(steps)
        if not len(contacts.forces):
            for frame, pad in self.pads.items():
                pad.clear()
                self.source.shifts[frame] = pad.shift
            return
        dt = self.model.opt.timestep

        def approach(which: np.ndarray) -> np.ndarray:
            return closing_speeds(self.model, self.data, contacts, which) * dt

        touched, carried = np.zeros((2, len(contacts.forces)), bool)
        for frame, pad in self.pads.items():
            carried |= pad.press(contacts, *self.source.place(self.data, frame), approach)
            touched |= pad.touched(contacts)
            self.source.shifts[frame] = pad.shift
        beside_n = float(contacts.forces[touched & ~carried].sum())
        if beside_n > 0 and not self.beside_ns:
            names = {pad.sensor.name for pad in self.pads.values() if pad.sensor and pad.touched(contacts).any()}
            _logger.warning(
                "engine: %.3g N at %.3f s press beside the taxels of %s (by more than %g radii), and are not in its "
                "readings",
                beside_n,
                t_s,
                ", ".join(sorted(names)) or "a skin",
                REACH_RADII,
            )
        self.beside_ns += beside_n * dt * len(steps)

    def _break(self, broken: Sequence[int]) -> None:
        """Break these geoms, and restore all others: a broken geom stays where it is, and nothing touches it."""
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
        """Return the state of MuJoCo on which the integration depends, and that of the skins on its bodies."""
        spec = self._mujoco.mjtState.mjSTATE_INTEGRATION
        values = np.empty(self._mujoco.mj_stateSize(self.model, spec))
        self._mujoco.mj_getState(self.model, self.data, values, spec)
        return {
            "left_out_s": self._left_out_s,
            "beside_ns": self.beside_ns,
            "values": values,
            "broken": sorted(self.source.hidden),
            "pads": [pad.state() for pad in self.pads.values()],
        }

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """Return a callable that restores ``state``.

        Raises:
            ValueError: the state is not one of this model.
        """
        spec, values, left_out_s = self._mujoco.mjtState.mjSTATE_INTEGRATION, state["values"], state["left_out_s"]
        size = self._mujoco.mj_stateSize(self.model, spec)
        if values.shape != (size,) or values.dtype != np.float64:
            raise ValueError(f"expected {size} numbers of MuJoCo, got {values.shape} {values.dtype}")
        arrays = [values, *(np.ravel(pad[name]) for pad in state["pads"] for name in ("along", "pulled", "shift"))]
        if not np.isfinite(np.concatenate(arrays)).all():
            raise ValueError("expected finite numbers of MuJoCo and of the skins on its bodies")
        if len(state["pads"]) != len(self.pads):
            raise ValueError(f"expected {len(self.pads)} skins on MuJoCo's bodies, got {len(state['pads'])}")

        def restore() -> None:
            self._mujoco.mj_setState(self.model, self.data, values, spec)
            self._left_out_s, self.beside_ns = float(left_out_s), float(state["beside_ns"])
            self._break(state["broken"])
            for (frame, pad), each in zip(self.pads.items(), state["pads"]):
                pad.restore(each)
                self.source.shifts[frame] = pad.shift

        return restore


def _log_mujoco_warning(text: str) -> None:
    """Log a warning of MuJoCo as debug text, since a warning that matters ends the run with a message."""
    _logger.debug("engine: MuJoCo: %s", text)


def _largest_contact_force(contacts: Contacts, geom: int) -> float:
    """Return the largest contact force of any other geom on this one [N]."""
    mine = contacts.geoms == geom
    touching = mine.any(axis=1)
    others = np.where(mine[touching, 0], contacts.geoms[touching, 1], contacts.geoms[touching, 0])
    forces = contacts.forces[touching]
    return max((float(forces[others == other].sum()) for other in np.unique(others)), default=0.0)
