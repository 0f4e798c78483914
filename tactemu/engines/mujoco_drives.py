"""The motors of a device on the joints of a MuJoCo model: what the firmware wants goes in, what they did comes back.

Each joint gets an actuator of the model, a spring and a damper from the joint to where the firmware holds it, or a
force, and both at most what the firmware allows. MuJoCo integrates them, the damper implicitly.
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
from tactemu.base.errors import SceneError, nearest
from tactemu.engines.mujoco_source import load_mujoco
from tactemu.scene.schema import JointTable

_logger = logging.getLogger(__name__)

MAX_RANGE_RATIO, ENDLESS_TRAVEL = 10.0, 1e3
"""A joint's range in the model is at most so many times that of its motor, and not less than the inverse; a motor that
goes so many radians or metres has no stops."""
MAX_STIFFNESS_SHARE = 0.5
"""Of stiffness dt² / inertia: a stiffer spring would not be integrated well."""


class Drive:
    """The motors of one device.

    Args:
        skin: the device's name in the scene.
        device: its firmware.
        joints: by the name of the motor, the joint of the model that it moves.
        local_ns: the device's own clock at a time of the scene [ns].

    Raises:
        SceneError: it has no such motor, or none at all that an engine could move.
    """

    def __init__(
        self, skin: str, device: Device, joints: Mapping[str, str | JointTable], local_ns: Callable[[int], int]
    ):
        self._where, self._device, self._local_ns = f"skin {skin!r}: joints", device, local_ns
        names = device.drives.names if device.drives else ()
        if not names:
            raise SceneError(f"{self._where}: {device.name} has no motors that an engine could move")
        for name in joints:
            if name not in names:
                hint = f"{nearest(name, names)} (motors: {', '.join(names)})"
                raise SceneError(f"{self._where}: {device.name} has no {name!r}{hint}")
        tables = [JointTable(joint=given) if isinstance(given, str) else given for given in joints.values()]
        self.joints = [table.joint for table in tables]
        self._motor = np.array([names.index(name) for name in joints])
        self._zero, self._ratio = (np.array([getattr(table, key) for table in tables]) for key in ("zero", "ratio"))

    @property
    def _motors(self) -> Motors:
        """Those of its present life: a restart makes new ones."""
        motors = self._device.drives
        assert motors is not None
        return motors

    # -- the model ---------------------------------------------------------------------------------------------------

    def add_to(self, spec: Any) -> None:
        """Give each joint an actuator.

        Raises:
            SceneError: no such joint, one that neither turns nor slides, or one that is driven already.
        """
        mujoco = load_mujoco()
        driven = {actuator.target: actuator.name for actuator in spec.actuators}
        known = [joint.name for joint in spec.joints if joint.name]
        for name in self.joints:
            joint = spec.joint(name)
            if joint is None:
                has = ", ".join(known) or "none"
                raise SceneError(f"{self._where}: no joint {name!r} in the model{nearest(name, known)} (joints: {has})")
            if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                raise SceneError(
                    f"{self._where}: joint {name!r} neither turns nor slides, as those do that motors move"
                )
            if name in driven:
                by = driven[name] or "without a name"
                raise SceneError(f"{self._where}: joint {name!r} has an actuator already ({by}); one motor for a joint")
            driven[name] = f"{self._where}"
            spec.add_actuator(
                name=f"{self._where}.{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE, gainprm=[1.0] + [0.0] * 9, forcelimited=1, forcerange=[-1, 1],
            )  # fmt: skip

    def bind(self, model: Any) -> None:
        """Find the joints in the compiled model.

        Raises:
            SceneError: a range that looks like degrees for radians.
        """
        ids = [model.joint(name).id for name in self.joints]
        self._actuators = np.array([model.actuator(f"{self._where}.{name}").id for name in self.joints])
        self._places, self._speeds = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        low, high = self._motors.travel
        travel = ((high - low)[self._motor] * np.abs(self._ratio)).tolist()
        for joint, name, span, ratio in zip(ids, self.joints, travel, self._ratio.tolist()):
            if model.jnt_limited[joint] and span < ENDLESS_TRAVEL * abs(ratio):
                self._check_range(name, span, model.jnt_range[joint], int(model.jnt_type[joint]))
        inertia = np.maximum(1 / model.dof_invweight0, model.dof_armature)[self._speeds]  # MuJoCo forgets it at times
        wanted = self._motors.setpoints(0).stiffness[self._motor] / self._ratio**2
        self._stiffness = np.minimum(wanted, MAX_STIFFNESS_SHARE * inertia / model.opt.timestep**2)
        self._damping = 2 * np.sqrt(self._stiffness * inertia)
        soft = [name for name, have, want in zip(self.joints, self._stiffness, wanted) if have < want / 2]
        if soft:
            _logger.warning(
                "%s: %s: too light for stiff motors at a time step of %g s, so they give way; a smaller `timestep`, or "
                "the inertia of the gears as `armature`, makes them stiff", self._where, ", ".join(soft),
                model.opt.timestep,
            )  # fmt: skip

    def _check_range(self, name: str, travel: float, limits: np.ndarray, kind: int) -> None:
        """Whether a joint's limits can be those of its motor."""
        low, high = map(float, limits)
        if travel / MAX_RANGE_RATIO <= high - low <= travel * MAX_RANGE_RATIO:
            return
        unit = "rad" if kind == load_mujoco().mjtJoint.mjJNT_HINGE else "m"
        much = high - low > travel
        hint = {
            ("rad", True): "degrees where the file means radians?",
            ("rad", False): 'radians where the file means degrees? <compiler angle="radian"/> says so',
        }.get((unit, much), "another unit, or a `ratio`?")
        raise SceneError(
            f"{self._where}: joint {name!r} goes from {low:g} to {high:g} {unit}, its motor over {travel:g} {unit}: "
            f"{hint}"
        )

    # -- each step ---------------------------------------------------------------------------------------------------

    def release(self) -> None:
        """The model starts anew."""
        self._motors.leave_engine()

    def command(self, model: Any, data: Any, t_s: float, since_s: float) -> None:
        """What the firmware wants at ``t_s`` becomes what the actuators do.

        The speed is the mean since ``since_s``: a short move between two steps is no kick at full speed.
        """
        if not self._motors.is_in_engine:
            self.report(data, t_s)
        t_ns = self._local_ns(round(t_s * 1e9))
        self._device.joints(t_ns)  # a firmware may do something because time has passed
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
        """What the joints and their actuators did becomes what the firmware measures."""
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
        SceneError: names it.
    """
    seen: set[str] = set()
    for drive in drives:
        for name in drive.joints:
            if name in seen:
                raise SceneError(f"{drive._where}: two motors on joint {name!r}; one motor for a joint")
            seen.add(name)
