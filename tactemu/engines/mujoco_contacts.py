"""MuJoCo's contact forces, and skins that are pressed in until they measure the same force.

MuJoCo's contacts are points that give a little, by parameters that do not describe rubber. A skin's model computes what
an indentation does to each taxel. So MuJoCo provides the force, and the skin its distribution: the skin's frame is
moved against the touched object, or back, until the skin's total force equals that of MuJoCo's contacts. What is left
of the difference in a step (an impact has no time to settle; float32 resolves a light object's depth by per cents) is
one factor on all taxels (:class:`~tactemu.sensors.load_match.LoadMatch`). If the skin's model has friction, its frame
is likewise moved along the object until the friction force is MuJoCo's.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.engines.mujoco_source import load_mujoco
from tactemu.geometry.bodies import Body
from tactemu.sensors.load_match import LoadMatch

if TYPE_CHECKING:
    from tactemu.sensors.sensor import Sensor

_logger = logging.getLogger(__name__)

FIRST_DEPTH_M = 20e-6
"""Depth of a skin at the first touch."""
MAX_DEPTH_M = 5e-3
"""Largest depth of a skin."""
MIN_FORCE_N = 1e-6
"""Force below which a contact counts as none."""
FIRST_EXPONENT = 2.0
"""Exponent of force over depth until it is known: it is 1 for a flat face, 2 for a ball on springs."""
MIN_EXPONENT = 1.0
"""Smallest exponent of force over depth."""
MAX_EXPONENT = 5.0
"""Largest exponent of force over depth, for an object that touches ever more taxels."""
MAX_STILL_EXPONENT = 500.0
"""Largest exponent for a contact that stands still: under a light object that hardly touches, the force is far steeper,
which can be measured only while MuJoCo's contact stands still."""
MIN_DEPTH_CHANGE = 0.01
"""Relative change of depth from which the exponent is computed."""
MIN_STILL_DEPTH_CHANGE = 1e-4
"""Relative change of depth from which the exponent is computed for a contact that stands still."""
STILL_SHARE = 0.01
"""Relative change of force and overlap below which a contact stands still."""
FORCE_TOLERANCE = 2e-3
"""Relative error of the skin's force at which a contact that stands still is left as it is."""
BOUND_STEPS = 8
"""Steps for which a depth that was too small or too large bounds the next ones, since taxels may roll meanwhile."""
SLIDING_SHARE = 0.95
"""Share of the friction limit above which MuJoCo's bodies slide, so that the skin is not moved further."""
MAX_SHEAR_STIFFNESS = 1.0
"""Largest stiffness of a skin along its surface, in shares of force per depth."""
MIN_SHEAR_STIFFNESS = 0.03
"""Smallest stiffness of a skin along its surface, in shares of force per depth."""
MIN_SHIFT_SHARE = 0.01
"""Shift along the surface, as a share of the depth, from which the shear stiffness is computed."""
MIN_CARRIED = 0.9
"""Smallest share of a load at the largest depth that is not reported."""
REACH_RADII = 4.0
"""Distance from a taxel within which a contact is the skin's, in radii of the taxels."""


@dataclass(frozen=True)
class Contacts:
    """The contacts of one step that press, or of several, each with its share of the mean force."""

    geoms: np.ndarray
    """Ids of the two geoms, shape ``(n, 2)``."""
    positions: np.ndarray
    """World positions [m], shape ``(n, 3)``."""
    normals: np.ndarray
    """World normals, from the first geom to the second, shape ``(n, 3)``."""
    forces: np.ndarray
    """Normal forces [N], shape ``(n,)``."""
    drags: np.ndarray
    """Friction forces on the second geom [N], world, shape ``(n, 3)``."""
    depths: np.ndarray
    """Overlaps of the geoms [m], shape ``(n,)``."""
    ages: np.ndarray
    """Steps of the model since the overlaps, of which one is since the last forces, shape ``(n,)``."""


def contacts_of(model: Any, data: Any, geoms: np.ndarray | None = None) -> Contacts:
    """Return the contacts of MuJoCo's last step; given a mask of geoms, only those between one of them and another."""
    mujoco, wrench, contact = load_mujoco(), np.zeros(6), data.contact
    which = np.arange(data.ncon)
    if geoms is not None and data.ncon:
        mine = geoms[contact.geom]
        which = np.flatnonzero(mine[:, 0] | mine[:, 1])
    forces, drags = np.zeros(len(which)), np.zeros((len(which), 3))
    for k, index in enumerate(which):
        mujoco.mj_contactForce(model, data, index, wrench)
        forces[k], drags[k] = wrench[0], wrench[1:3] @ contact.frame[index].reshape(3, 3)[1:]
    press = forces > 0
    forces, drags, which = forces[press], drags[press], which[press]
    normals, depths, ages = contact.frame[which][:, :3], -contact.dist[which], np.ones(len(which))
    return Contacts(contact.geom[which], contact.pos[which], normals, forces, drags, depths, ages)


def closing_speeds(model: Any, data: Any, contacts: Contacts, which: np.ndarray) -> np.ndarray:
    """Return the speeds [m/s] at which the geoms of some contacts approach each other after MuJoCo's last step."""
    mujoco, jacobian, speeds = load_mujoco(), np.zeros((3, model.nv)), np.zeros(len(which))
    for k, contact in enumerate(which):
        for geom, side in zip(contacts.geoms[contact], (1.0, -1.0)):
            mujoco.mj_jac(model, data, jacobian, None, contacts.positions[contact], model.geom_bodyid[geom])
            speeds[k] += side * (contacts.normals[contact] @ jacobian @ data.qvel)
    return speeds


def mean_contacts(steps: Sequence[Contacts]) -> Contacts:
    """Return the contacts of several steps, whose sum of forces is the mean force."""
    if len(steps) == 1:
        return steps[0]
    if not any(len(c.forces) for c in steps):
        return steps[-1]
    share = 1 / len(steps)
    parts = [
        (c.geoms, c.positions, c.normals, c.forces * share, c.drags * share, c.depths, c.ages + (len(steps) - 1 - k))
        for k, c in enumerate(steps)
    ]
    return Contacts(*map(np.concatenate, zip(*parts)))


class Pad:
    """A skin on a MuJoCo body.

    Args:
        frame: the body of the scene that carries the skin; its owner poses it, displaced by :attr:`shift`.
        geoms: a mask of the model's geoms that move with the skin.
    """

    def __init__(self, frame: Body, geoms: np.ndarray):
        self.frame, self.geoms = frame, geoms
        self.sensor: Sensor | None = None
        self._load: LoadMatch | None = None
        self.depth = 0.0
        """The total depth to which the skin is pressed [m]."""
        self.shift = np.zeros(3)
        """The displacement of the frame, world [m]."""
        self.force = 0.0
        """The normal force of MuJoCo's contacts [N]."""
        self._exponent, self._before = FIRST_EXPONENT, (0.0, 0.0)
        """The exponent of force over depth, and depth and force of the step before; 0 if they are not known."""
        self._still = (0.0, 0.0)
        """Force and overlap of MuJoCo's contact since it stands still."""
        self._bounds: list[tuple[float, float, int]] = []
        """Depths tried since then, the skin's force at each [m, N], and the number of steps since."""
        self.is_overloaded = False
        """Was a load more than the skin's model carries at its largest depth?"""
        self._measured: float | None = None
        """The skin's force in a restored state, whose step was not computed here."""
        self._friction = 0.0
        self.along = np.zeros(3)
        """The displacement of the skin along the touched object, in the skin's frame [m]."""
        self._give, self._pulled = 0.0, (np.zeros(3), np.zeros(3))
        """The displacement per friction force; the last displacement, and the friction force before it."""

    def attach(self, sensor: Sensor, reason: str | None) -> None:
        """Attach the skin that the frame carries, if it has forces that can be summed.

        Args:
            sensor: the skin.
            reason: the reason of the stage that makes their sum MuJoCo's, for the plan; ``None``: without that stage.
        """
        if not sensor.transducers and "force" in sensor.quantities:
            self.sensor = sensor
            self._friction = float(getattr(sensor.model, "friction", 0.0))
            self._reach = REACH_RADII * float(np.max(sensor.radii))
            if sensor.model.load_fields and reason is not None:
                self._load = sensor._load = LoadMatch(reason)

    def clear(self) -> None:
        """Reset the pad: nothing touches the skin."""
        self.depth, self.shift, self.force, self._measured = 0.0, np.zeros(3), 0.0, None
        self._exponent, self._before = FIRST_EXPONENT, (0.0, 0.0)
        self._still, self._bounds = (0.0, 0.0), []
        if self._load is not None:
            self._load.set(0.0)
        self.along, self._give, self._pulled = np.zeros(3), 0.0, (np.zeros(3), np.zeros(3))

    def touched(self, contacts: Contacts) -> np.ndarray:
        """Return which contacts are between a geom that moves with the skin and another, as a mask; none without a
        skin that has forces."""
        mine = self.geoms[contacts.geoms]
        return (mine[:, 0] != mine[:, 1]) & (self.sensor is not None)

    def press(
        self,
        contacts: Contacts,
        position: np.ndarray,
        turn: np.ndarray,
        closing_m: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Compute depth and shift of the skin for the next step, and return the contacts that it carries, a mask.

        Args:
            contacts: the contacts of MuJoCo's last step.
            position: world position of the frame [m].
            turn: orientation of the frame, a matrix.
            closing_m: returns by how much the geoms of some contacts approach each other in a step of the model [m].
        """
        carried = np.zeros(len(contacts.forces), bool)
        which = np.flatnonzero(self.touched(contacts))
        if self.sensor is None or not len(which):
            self.clear()
            return carried
        measured, self._measured = self._modelled_force(), None
        local = (contacts.positions[which] - position) @ turn
        away = np.linalg.norm(local[:, None] - self.sensor.positions.reshape(1, -1, 3), axis=-1).min(axis=1)
        which = which[away < self._reach]
        carried[which] = True
        self.force = float(contacts.forces[which].sum())
        if self.force < MIN_FORCE_N:
            self.clear()
            return carried
        sides = np.where(self.geoms[contacts.geoms[which, 0]], 1.0, -1.0)
        pulls = sides[:, None] * contacts.normals[which] * contacts.forces[which, None]
        inward = pulls.sum(axis=0)
        length = float(np.linalg.norm(inward))
        last = which[contacts.ages[which] == contacts.ages[which].min()]
        share = contacts.forces[last] / contacts.forces[last].sum()
        overlap = float(contacts.depths[last] @ share)
        self._bound(measured, overlap)
        if not self._bounds:  # it moves, and poses are those after the step
            overlap += float((closing_m(last) * contacts.ages[last]) @ share)
        if self._bounds and abs(measured - self.force) <= FORCE_TOLERANCE * self.force:
            depth = self.depth
        elif measured > 0 and self.depth > 0:
            self._learn(measured)
            depth = self.depth * float(np.clip((self.force / measured) ** (1 / self._exponent), 0.5, 2.0))
        else:
            depth = max(2 * self.depth, FIRST_DEPTH_M) if self._bounds else max(2 * self.depth, overlap, FIRST_DEPTH_M)
        self.depth = min(self._between(depth), MAX_DEPTH_M)
        self._report(self._load is not None and self.depth == MAX_DEPTH_M and measured < MIN_CARRIED * self.force)
        self.shift = inward / length * (self.depth - overlap) if length > 0.2 * self.force else np.zeros(3)
        if self._friction and measured > 0 and self._factor > 0:
            drag = -(sides[:, None] * contacts.drags[which]).sum(axis=0)
            self._drag(drag @ turn, inward / length @ turn, measured)
            self.shift = self.shift + turn @ self.along
        if self._load is not None:
            self._load.set(self.force)
        return carried

    def _report(self, is_overloaded: bool) -> None:
        """Log once that the skin's model cannot carry the load."""
        if is_overloaded and not self.is_overloaded and self.sensor is not None:
            self.is_overloaded = True
            _logger.warning(
                "engine: skin %r carries %.3g N, which press deeper than %g mm into its model: its forces are scaled; "
                "make the model stiffer",
                self.sensor.name,
                self.force,
                MAX_DEPTH_M * 1e3,
            )

    def _drag(self, drag: np.ndarray, inward: np.ndarray, measured: float) -> None:
        """Move the skin along the touched object, towards the friction force ``drag``; vectors are in its frame."""
        assert self.sensor is not None
        across = np.eye(3) - np.outer(inward, inward)
        factor = self._factor  # the skin's model has its forces without it
        has = across @ self.sensor.quantity("force", ground_truth=True).sum(axis=0) / factor
        wanted = across @ drag / factor
        most, pull = self._friction * measured, float(np.linalg.norm(wanted))
        wanted *= min(1.0, SLIDING_SHARE * most / max(pull, MIN_FORCE_N))
        stiff = measured / self.depth
        moved, had = self._pulled
        if (way := float(moved @ moved)) > (MIN_SHIFT_SHARE * self.depth) ** 2:
            learnt = float((had - has) @ moved) / way
            self._give = 1 / float(np.clip(learnt, MIN_SHEAR_STIFFNESS * stiff, MAX_SHEAR_STIFFNESS * stiff))
        along = across @ self.along - (self._give or 1 / (MAX_SHEAR_STIFFNESS * stiff)) * (wanted - has)
        along *= min(1.0, most / (MIN_SHEAR_STIFFNESS * stiff) / max(float(np.linalg.norm(along)), FIRST_DEPTH_M))
        self._pulled, self.along = (along - self.along, has), along

    def _bound(self, measured: float, overlap: float) -> None:
        """Remember the depth of this step while MuJoCo's contact stands still."""
        force, deep = self._still
        if abs(self.force - force) > STILL_SHARE * force or abs(overlap - deep) > STILL_SHARE * abs(deep):
            self._still, self._bounds = (self.force, overlap), []
        elif self.depth > 0:
            kept = [(depth, had, steps + 1) for depth, had, steps in self._bounds if steps < BOUND_STEPS]
            agree = [
                each for each in kept if (each[0] < self.depth) == (each[1] < measured) or each[1] == measured == 0
            ]
            self._bounds = [*agree, (self.depth, measured, 0)]

    def _between(self, depth: float) -> float:
        """Return ``depth`` if it lies between the nearest depths that were too small and too large, else their mean."""
        low = max((tried for tried, measured, _ in self._bounds if measured < self.force), default=0.0)
        high = min((tried for tried, measured, _ in self._bounds if measured > self.force), default=np.inf)
        if depth == self.depth or low < depth < high or not low < high < np.inf:
            return depth
        return (low + high) / 2

    def _learn(self, measured: float) -> None:
        """Estimate the exponent of force over depth from this step and the one before."""
        depth, force = self._before
        known, most = (MIN_STILL_DEPTH_CHANGE, MAX_STILL_EXPONENT) if self._bounds else (MIN_DEPTH_CHANGE, MAX_EXPONENT)
        if depth > 0 and abs(self.depth / depth - 1) > known:
            slope = np.log(measured / force) / np.log(self.depth / depth)
            if slope >= MIN_EXPONENT or not self._bounds:  # a solver that has not converged yet is noise
                self._exponent = float(np.clip(slope, MIN_EXPONENT, most))
        self._before = self.depth, measured

    @property
    def _factor(self) -> float:
        """The factor on all taxels in the last step."""
        return 1.0 if self._load is None else self._load.factor

    def _modelled_force(self) -> float:
        """Return the total normal force of the last step as the skin's model has it [N]."""
        if self._measured is not None:
            return self._measured
        return self.skin_force() if self._load is None else self._load.modelled

    def skin_force(self) -> float:
        """Return the total normal force on the skin in the last step [N], without imperfections."""
        if self.sensor is None or self.sensor.imperfections is None:  # the scene is not built yet
            return 0.0
        forces = self.sensor.quantity("force", ground_truth=True)
        return float(np.maximum(-np.einsum("ij,ij->i", forces, self.sensor.normals.reshape(-1, 3)), 0.0).sum())

    def state(self) -> dict[str, Any]:
        """Return the state on which the next step depends."""
        had = self._modelled_force()
        numbers = {"depth": self.depth, "force": self.force, "felt": had, "exponent": self._exponent}
        tried = {"before": list(self._before), "still": list(self._still), "bounds": [list(b) for b in self._bounds]}
        along = {"along": self.along.copy(), "give": self._give, "pulled": np.array(self._pulled)}
        return {**numbers, **tried, **along, "shift": self.shift.copy()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a state."""
        self.depth, self.shift, self.force = float(state["depth"]), np.array(state["shift"]), float(state["force"])
        self._measured, self._exponent = float(state["felt"]), float(state["exponent"])
        self._before, self._still = tuple(map(float, state["before"])), tuple(map(float, state["still"]))
        self._bounds = [(float(depth), float(measured), int(steps)) for depth, measured, steps in state["bounds"]]
        self.along, self._give = np.array(state["along"]), float(state["give"])
        moved, had = np.array(state["pulled"])
        self._pulled = moved, had
        if self._load is not None:
            self._load.restore(self.force, self._measured)
