"""The motors of a device on the joints of a MuJoCo model: the firmware's targets go in, the motors' motion comes back.

Each joint gets an actuator of the model: a spring and a damper to the position at which the firmware holds the joint,
or a force, both limited to what the firmware allows. MuJoCo integrates them, the damper implicitly.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from firmware_protocols import Device
from firmware_protocols.motors import Motors
from tactemu.base.errors import SceneError, no_such
from tactemu.engines.mujoco_source import load_mujoco
from tactemu.scene.schema import JointTable

_logger = logging.getLogger(__name__)

MAX_RANGE_RATIO = 10.0
"""Largest ratio between a joint's range in the model and that of its motor, either way; beyond it units are wrong."""
ENDLESS_TRAVEL = 1e3
"""Travel [rad, m] from which on a motor has no stops."""
MAX_STIFFNESS_SHARE = 0.5
"""Largest stiffness dt² / inertia: a stiffer spring would not be integrated well."""


class Drive:
    """The motors of one device.

    Args:
        skin: the device's name in the scene.
        device: the firmware.
        joints: the joint of the model that each motor moves, by the motor's name.
        local_ns: returns the time of the device's own clock at a time of the scene [ns].

    Raises:
        SceneError: the device has no such motor, or no motors that an engine can move.
    """

    def __init__(
        self, skin: str, device: Device, joints: Mapping[str, str | JointTable], local_ns: Callable[[int], int]
    ):
        self._where, self._device, self._local_ns = f"skin {skin!r}: joints", device, local_ns
        names = device.drives.names if device.drives else ()
        if not names:
            raise SceneError(f"{self._where}: {device.name} has no motors that an engine can move; remove `joints`")
        for name in joints:
            if name not in names:
                raise SceneError(f"{self._where}: {device.name} has {no_such('motor', name, names)}")
        tables = [JointTable(joint=given) if isinstance(given, str) else given for given in joints.values()]
        self.joints = [table.joint for table in tables]
        self._motor = np.array([names.index(name) for name in joints])
        self._zero, self._ratio = (np.array([getattr(table, key) for table in tables]) for key in ("zero", "ratio"))

    @property
    def _motors(self) -> Motors:
        """The device's motors since its last restart, which makes new ones."""
        motors = self._device.drives
        assert motors is not None
        return motors

    # -- the model ---------------------------------------------------------------------------------------------------

    def add_to(self, spec: Any) -> None:
        """Add an actuator for each joint to the model.

        Raises:
            SceneError: there is no such joint, it neither turns nor slides, or it is driven already.
        """
        mujoco = load_mujoco()
        driven = {actuator.target: actuator.name for actuator in spec.actuators}
        known = [joint.name for joint in spec.joints if joint.name]
        for name in self.joints:
            joint = spec.joint(name)
            if joint is None:
                raise SceneError(f"{self._where}: the model has {no_such('joint', name, known)}")
            if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                raise SceneError(
                    f"{self._where}: joint {name!r} is neither a hinge nor a slide, so that a motor cannot move it"
                )
            if name in driven:
                by = driven[name] or "without a name"
                raise SceneError(f"{self._where}: joint {name!r} already has an actuator ({by}); remove one of the two")
            driven[name] = f"{self._where}"
            spec.add_actuator(
                name=f"{self._where}.{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE, gainprm=[1.0] + [0.0] * 9, forcelimited=1, forcerange=[-1, 1],
            )  # fmt: skip

    def bind(self, model: Any) -> None:
        """Find the joints in the compiled model.

        Raises:
            SceneError: a range looks like degrees instead of radians.
        """
        ids = [model.joint(name).id for name in self.joints]
        self._actuators = np.array([model.actuator(f"{self._where}.{name}").id for name in self.joints])
        self._places, self._speeds = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        low, high = self._motors.travel
        travel = ((high - low)[self._motor] * np.abs(self._ratio)).tolist()
        for joint, name, span, ratio in zip(ids, self.joints, travel, self._ratio.tolist()):
            if model.jnt_limited[joint] and span < ENDLESS_TRAVEL * abs(ratio):
                self._check_range(name, span, model.jnt_range[joint], int(model.jnt_type[joint]))
        inertia = np.maximum(1 / model.dof_invweight0, model.dof_armature)[
            self._speeds
        ]  # MuJoCo leaves out the armature at times
        wanted = self._motors.setpoints(0).stiffness[self._motor] / self._ratio**2
        self._stiffness = np.minimum(wanted, MAX_STIFFNESS_SHARE * inertia / model.opt.timestep**2)
        self._damping = 2 * np.sqrt(self._stiffness * inertia)
        soft = [name for name, have, want in zip(self.joints, self._stiffness, wanted) if have < want / 2]
        if soft:
            _logger.warning(
                "%s: %s: too light for stiff motors at a time step of %g s, so that they give way; choose a smaller "
                "`timestep`, or give the inertia of the gears as `armature`", self._where, ", ".join(soft),
                model.opt.timestep,
            )  # fmt: skip

    def _check_range(self, name: str, travel: float, limits: np.ndarray, kind: int) -> None:
        """Raise :class:`SceneError` if a joint's limits cannot be those of its motor."""
        low, high = map(float, limits)
        if travel / MAX_RANGE_RATIO <= high - low <= travel * MAX_RANGE_RATIO:
            return
        unit = "rad" if kind == load_mujoco().mjtJoint.mjJNT_HINGE else "m"
        much = high - low > travel
        hint = {
            ("rad", True): "are these degrees where the file should have radians?",
            ("rad", False): 'are these radians in a file of degrees? Then add <compiler angle="radian"/>',
        }.get((unit, much), "check the unit, or give a `ratio`")
        raise SceneError(
            f"{self._where}: joint {name!r} moves from {low:g} to {high:g} {unit}, its motor over {travel:g} {unit}: "
            f"{hint}"
        )

    # -- each step ---------------------------------------------------------------------------------------------------

    def release(self) -> None:
        """Release the motors from the model, since it restarts."""
        self._motors.leave_engine()

    def command(self, model: Any, data: Any, t_s: float, since_s: float) -> None:
        """Set the actuators to the firmware's targets at ``t_s``.

        The speed is the mean since ``since_s``, so that a short move between two steps causes no jerk at full speed.
        """
        if not self._motors.is_in_engine:
            self.report(data, t_s)
        t_ns = self._local_ns(round(t_s * 1e9))
        self._device.joints(t_ns)  # lets the firmware act on the time that has passed
        before = self._motors.setpoints(self._local_ns(round(since_s * 1e9))).positions
        setpoints = self._motors.setpoints(t_ns)
        of, ratio = self._motor, self._ratio
        place = self._zero + ratio * setpoints.positions[of]
        speed = ratio * (setpoints.positions - before)[of] / (t_s - since_s) if t_s > since_s else 0.0 * place
        force, most = setpoints.forces[of] / ratio, setpoints.max_forces[of] / np.abs(ratio)
        held = np.isnan(force)
        data.ctrl[self._actuators] = np.where(held, self._stiffness * place + self._damping * speed, force)
        model.actuator_biasprm[self._actuators, 1] = np.where(held, -self._stiffness, 0.0)
        model.actuator_biasprm[self._actuators, 2] = np.where(held, -self._damping, 0.0)
        model.actuator_forcerange[self._actuators] = np.stack([-most, most], axis=1)

    def report(self, data: Any, t_s: float) -> None:
        """Give the positions, speeds and forces of the joints to the firmware as its measurements."""
        t_ns, motors, of = self._local_ns(round(t_s * 1e9)), self._motors, self._motor
        setpoints = motors.setpoints(t_ns)
        places, speeds, forces = setpoints.positions.copy(), setpoints.speeds.copy(), np.zeros(len(setpoints.positions))
        places[of] = (data.qpos[self._places] - self._zero) / self._ratio
        speeds[of] = data.qvel[self._speeds] / self._ratio
        forces[of] = data.actuator_force[self._actuators] * self._ratio
        motors.follow_engine(places, speeds, forces, t_ns)


def check_apart(drives: Iterable[Drive]) -> None:
    """Check that no joint has two motors.

    Raises:
        SceneError: a joint has two; the message names it.
    """
    seen: set[str] = set()
    for drive in drives:
        for name in drive.joints:
            if name in seen:
                raise SceneError(f"{drive._where}: there are two motors on joint {name!r}; give it one motor only")
            seen.add(name)
