"""Forces of contact as MuJoCo has them, and skins that are pressed in until they feel as much.

MuJoCo's contacts are points that give a little, by numbers that say how hard they are and nothing of rubber. A skin's
model knows what an indentation does to each taxel. So MuJoCo has the force, and the skin how it is spread: the frame
of a skin is moved against what it touches, or back, until what it feels in all is what MuJoCo's contacts have there.
Where the skin's model knows friction, its frame is moved along what it touches likewise, until the drag is MuJoCo's.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.engines.mujoco_source import load_mujoco
from tactemu.geometry.bodies import Body

if TYPE_CHECKING:
    from tactemu.sensors.sensor import Sensor

FIRST_DEPTH_M, MAX_DEPTH_M = 20e-6, 5e-3
"""How deep a skin is pressed at a first touch, and at most [m]."""
MIN_FORCE_N = 1e-6
FIRST_EXPONENT, MIN_EXPONENT, MAX_EXPONENT, MAX_STILL_EXPONENT = 2.0, 1.0, 5.0, 500.0
"""Force goes with this power of the depth until it is known, and with no less and no more: of a flat face it is 1, of a
ball on springs 2, of what comes to lie on ever more taxels even more. What is so light that its taxels hardly touch is
steeper by far, which can be told while MuJoCo's contact stands still."""
MIN_DEPTH_CHANGE, MIN_STILL_DEPTH_CHANGE = 0.01, 1e-4
"""Depths that differ by this share tell the power: in general, and of a contact that stands still."""
STILL_SHARE = 0.01
"""A contact stands still while its force and its overlap change by less than this share."""
FORCE_TOLERANCE = 2e-3
"""A contact that stands still is left as it is once the skin feels its force within this share."""
BOUND_STEPS = 8
"""Steps for which a depth that was too small or too large bounds the next ones: taxels may roll meanwhile."""
SLIDING_SHARE = 0.95
"""Drag from this share of friction on is left to how MuJoCo's bodies slide."""
MAX_SHEAR_STIFFNESS, MIN_SHEAR_STIFFNESS, MIN_SHIFT_SHARE = 1.0, 0.03, 0.01
"""A skin is so stiff along its surface, in shares of force per depth; moved by less than a share of its depth it does
not tell."""
REACH_RADII = 4.0
"""A contact is the skin's if a taxel is nearer than so many of its radii."""


@dataclass(frozen=True)
class Contacts:
    """The contacts of one step, those that press."""

    geoms: np.ndarray
    """Both sides, shape ``(n, 2)``."""
    positions: np.ndarray
    """World [m], shape ``(n, 3)``."""
    normals: np.ndarray
    """From the first geom to the second, shape ``(n, 3)``."""
    forces: np.ndarray
    """Normal [N], shape ``(n,)``."""
    drags: np.ndarray
    """Of friction on the second geom [N], world, shape ``(n, 3)``."""
    depths: np.ndarray
    """How far the geoms overlap [m], shape ``(n,)``."""


def contacts_of(model: Any, data: Any) -> Contacts:
    """Return the contacts of MuJoCo's last step."""
    mujoco, wrench, contact = load_mujoco(), np.zeros(6), data.contact
    forces, drags = np.zeros(data.ncon), np.zeros((data.ncon, 3))
    for k in range(data.ncon):
        mujoco.mj_contactForce(model, data, k, wrench)
        forces[k], drags[k] = wrench[0], wrench[1:3] @ contact.frame[k].reshape(3, 3)[1:]
    press = forces > 0
    normals = contact.frame[press][:, :3]
    return Contacts(contact.geom[press], contact.pos[press], normals, forces[press], drags[press], -contact.dist[press])


class Pad:
    """A skin on a MuJoCo body.

    Args:
        frame: the body of the scene that carries it, posed by its owner, displaced by :attr:`shift`.
        geoms: what moves with it, true at its places among the model's geoms.
    """

    def __init__(self, frame: Body, geoms: np.ndarray):
        self.frame, self._geoms = frame, geoms
        self.sensor: Sensor | None = None
        self.depth = 0.0
        """How deep the skin is pressed in all [m]."""
        self.shift = np.zeros(3)
        """Of the frame, world [m]."""
        self.force = 0.0
        """Of MuJoCo's contacts, along their normals [N]."""
        self._exponent, self._before = FIRST_EXPONENT, (0.0, 0.0)
        """Of force with depth, and depth and force at the step before, if they are known."""
        self._still = (0.0, 0.0)
        """Force and overlap of MuJoCo's contact since it stands still."""
        self._bounds: list[tuple[float, float, int]] = []
        """Depths tried since then, with the force that the skin felt there [m, N], and how many steps ago."""
        self._felt: float | None = None
        """As restored, of a step that was not computed here."""
        self._friction = 0.0
        self.along = np.zeros(3)
        """How far the skin is moved along what it touches, in its frame [m]."""
        self._give, self._pulled = 0.0, (np.zeros(3), np.zeros(3))
        """Distance per drag, and how far it was moved last, and the drag before."""

    def attach(self, sensor: Sensor) -> None:
        """The skin that it carries, if its forces can be summed."""
        if sensor.chain is None and "force" in sensor.layouts:
            self.sensor = sensor
            self._friction = float(getattr(sensor.model, "friction", 0.0))
            self._reach = REACH_RADII * float(np.max(sensor.probes.radii))

    def clear(self) -> None:
        """Nothing touches it."""
        self.depth, self.shift, self.force, self._felt = 0.0, np.zeros(3), 0.0, None
        self._exponent, self._before = FIRST_EXPONENT, (0.0, 0.0)
        self._still, self._bounds = (0.0, 0.0), []
        self.along, self._give, self._pulled = np.zeros(3), 0.0, (np.zeros(3), np.zeros(3))

    def press(self, contacts: Contacts, position: np.ndarray, turn: np.ndarray) -> None:
        """Find its shift.

        Args:
            contacts: of MuJoCo's last step.
            position: of its frame, world [m].
            turn: of its frame, a matrix.
        """
        if self.sensor is None:
            return
        mine = self._geoms[contacts.geoms]
        which = np.flatnonzero(mine[:, 0] != mine[:, 1])
        if not len(which):
            self.clear()
            return
        felt, self._felt = self.felt(), None
        local = (contacts.positions[which] - position) @ turn
        away = np.linalg.norm(local[:, None] - self.sensor.probes.positions[None], axis=-1).min(axis=1)
        which = which[away < self._reach]
        self.force = float(contacts.forces[which].sum())
        if self.force < MIN_FORCE_N:
            self.clear()
            return
        sides = np.where(mine[which, 0], 1.0, -1.0)
        pulls = sides[:, None] * contacts.normals[which] * contacts.forces[which, None]
        inward = pulls.sum(axis=0)
        length = float(np.linalg.norm(inward))
        overlap = float(contacts.depths[which] @ contacts.forces[which]) / self.force
        self._bound(felt, overlap)
        if self._bounds and abs(felt - self.force) <= FORCE_TOLERANCE * self.force:
            depth = self.depth
        elif felt > 0 and self.depth > 0:
            self._learn(felt)
            depth = self.depth * float(np.clip((self.force / felt) ** (1 / self._exponent), 0.5, 2.0))
        else:
            depth = max(2 * self.depth, FIRST_DEPTH_M) if self._bounds else max(2 * self.depth, overlap, FIRST_DEPTH_M)
        self.depth = min(self._between(depth), MAX_DEPTH_M)
        self.shift = inward / length * (self.depth - overlap) if length > 0.2 * self.force else np.zeros(3)
        if self._friction and felt > 0:
            drag = -(sides[:, None] * contacts.drags[which]).sum(axis=0)
            self._drag(drag @ turn, inward / length @ turn, felt)
            self.shift = self.shift + turn @ self.along

    def _drag(self, drag: np.ndarray, inward: np.ndarray, felt: float) -> None:
        """Move the skin along what it touches, towards a drag: vectors in its frame."""
        assert self.sensor is not None
        across = np.eye(3) - np.outer(inward, inward)
        has = across @ self.sensor.quantity("force", ground_truth=True).sum(axis=0)
        wanted = across @ drag
        most, pull = self._friction * felt, float(np.linalg.norm(wanted))
        wanted *= min(1.0, SLIDING_SHARE * most / max(pull, MIN_FORCE_N))
        stiff = felt / self.depth
        moved, had = self._pulled
        if (way := float(moved @ moved)) > (MIN_SHIFT_SHARE * self.depth) ** 2:
            learnt = float((had - has) @ moved) / way
            self._give = 1 / float(np.clip(learnt, MIN_SHEAR_STIFFNESS * stiff, MAX_SHEAR_STIFFNESS * stiff))
        along = across @ self.along - (self._give or 1 / (MAX_SHEAR_STIFFNESS * stiff)) * (wanted - has)
        along *= min(1.0, most / (MIN_SHEAR_STIFFNESS * stiff) / max(float(np.linalg.norm(along)), FIRST_DEPTH_M))
        self._pulled, self.along = (along - self.along, has), along

    def _bound(self, felt: float, overlap: float) -> None:
        """Remember the depth of this step while MuJoCo's contact stands still."""
        force, deep = self._still
        if abs(self.force - force) > STILL_SHARE * force or abs(overlap - deep) > STILL_SHARE * abs(deep):
            self._still, self._bounds = (self.force, overlap), []
        elif self.depth > 0:
            kept = [(depth, had, steps + 1) for depth, had, steps in self._bounds if steps < BOUND_STEPS]
            agree = [each for each in kept if (each[0] < self.depth) == (each[1] < felt) or each[1] == felt == 0]
            self._bounds = [*agree, (self.depth, felt, 0)]

    def _between(self, depth: float) -> float:
        """Return a depth, or halfway between the nearest that were too small and too large, if it is not between
        them.
        """
        low = max((tried for tried, felt, _ in self._bounds if felt < self.force), default=0.0)
        high = min((tried for tried, felt, _ in self._bounds if felt > self.force), default=np.inf)
        if depth == self.depth or low < depth < high or not low < high < np.inf:
            return depth
        return (low + high) / 2

    def _learn(self, felt: float) -> None:
        """How force goes with depth here, from this step and the one before."""
        depth, force = self._before
        known, most = (MIN_STILL_DEPTH_CHANGE, MAX_STILL_EXPONENT) if self._bounds else (MIN_DEPTH_CHANGE, MAX_EXPONENT)
        if depth > 0 and abs(self.depth / depth - 1) > known:
            slope = np.log(felt / force) / np.log(self.depth / depth)
            if slope >= MIN_EXPONENT or not self._bounds:  # a solver that has not converged yet is noise
                self._exponent = float(np.clip(slope, MIN_EXPONENT, most))
        self._before = self.depth, felt

    def felt(self) -> float:
        """What the skin felt in all at the last step [N], before anything spoilt it."""
        if self._felt is not None:
            return self._felt
        if self.sensor is None or self.sensor.imperfections is None:  # not built yet
            return 0.0
        forces = self.sensor.quantity("force", ground_truth=True)
        return float(np.maximum(-np.einsum("ij,ij->i", forces, self.sensor.probes.normals), 0.0).sum())

    def state(self) -> dict[str, Any]:
        """What the next step follows from."""
        numbers = {"depth": self.depth, "force": self.force, "felt": self.felt(), "exponent": self._exponent}
        tried = {"before": list(self._before), "still": list(self._still), "bounds": [list(b) for b in self._bounds]}
        along = {"along": self.along.copy(), "give": self._give, "pulled": np.array(self._pulled)}
        return {**numbers, **tried, **along, "shift": self.shift.copy()}

    def take(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.depth, self.shift, self.force = float(state["depth"]), np.array(state["shift"]), float(state["force"])
        self._felt, self._exponent = float(state["felt"]), float(state["exponent"])
        self._before, self._still = tuple(map(float, state["before"])), tuple(map(float, state["still"]))
        self._bounds = [(float(depth), float(felt), int(steps)) for depth, felt, steps in state["bounds"]]
        self.along, self._give = np.array(state["along"]), float(state["give"])
        moved, had = np.array(state["pulled"])
        self._pulled = moved, had
