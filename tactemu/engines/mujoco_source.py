"""The geoms of a MuJoCo model as bodies of a scene, so that a skin on a MuJoCo body touches MuJoCo's geoms.

::

    model = mujoco.MjModel.from_xml_path("hand.xml")
    data = mujoco.MjData(model)
    scene = tt.Scene(dt=model.opt.timestep)
    source = tt.MujocoSource(scene, model)
    skin = scene.add_sensor(tt.KinematicTaxel(...), link=source.geom("fingertip"))
    sim = scene.build()
    while True:
        mujoco.mj_step(model, data)
        source.update(sim, data)
        sim.step()
        skin.read()

MuJoCo computes the motion and the contact forces; the skin's readings follow from the poses and velocities of the
geoms. MuJoCo's contacts are soft, so that geoms overlap by a little: that overlap is the depth that the skin measures.
It needs the extra ``tactemu[mujoco]``.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.base.errors import SceneError, no_such
from tactemu.engines.mujoco_skeleton import skeleton
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.shapes.mesh import Mesh
from tactemu.geometry.shapes.registry import SHAPES, shape_class
from tactemu.geometry.shapes.shape import Shape

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


_AWAY = (0.0, 0.0, -100.0)


def load_mujoco():
    """Return the module ``mujoco``.

    Raises:
        SceneError: MuJoCo is not installed.
    """
    try:
        import mujoco
    except ImportError:
        raise SceneError("MuJoCo is not installed: pip install 'tactemu[mujoco]'") from None
    return mujoco


_RANGES = {
    "jnt_range": ("joint", "range"), "jnt_actfrcrange": ("joint", "actuatorfrcrange"),
    "tendon_range": ("tendon", "range"), "tendon_actfrcrange": ("tendon", "actuatorfrcrange"),
    "actuator_ctrlrange": ("actuator", "ctrlrange"), "actuator_forcerange": ("actuator", "forcerange"),
    "actuator_actrange": ("actuator", "actrange"),
}  # fmt: skip
"""The fields of a model that hold ranges, with the kind of element and the name of the attribute."""


def check_ranges(model: Any, file: Any) -> None:
    """Check that no range of a compiled model is reversed, which MuJoCo would ignore.

    Raises:
        SceneError: a range is reversed; the message names the element.
    """
    for field, (kind, attribute) in _RANGES.items():
        ranges = getattr(model, field)
        for k in np.flatnonzero(ranges[:, 0] > ranges[:, 1]):
            low, high = ranges[k].tolist()
            name = getattr(model, kind)(int(k)).name or f"number {k}"
            raise SceneError(
                f"engine: {file}: {kind} {name!r}: {attribute} is from {low:g} to {high:g}; give the lower end first"
            )


def shape_of(kind: str, size: list[float]) -> Shape | None:
    """Return the shape of a geom that is no mesh, given MuJoCo's name of its kind and its half sizes [m].

    Return ``None`` if there is no such shape.
    """
    for shape in map(shape_class, SHAPES):
        if shape.mujoco_geom == kind:
            return shape.from_mujoco(size)
    if kind == "ellipsoid":
        import trimesh

        return Mesh(source=trimesh.creation.icosphere(5), scale=size)
    return None


class MujocoSource:
    """The geoms of a MuJoCo model in a scene, posed from MuJoCo's data.

    Args:
        scene: the scene in which the geoms become bodies, named as in the model.
        model: an ``mujoco.MjModel``.
        geoms: names or ids of the geoms to add; ``None``: all that take part in collisions.

    Raises:
        SceneError: MuJoCo is not installed, there is no such geom, or its kind is not supported.
    """

    def __init__(self, scene: Scene, model: Any, geoms: Iterable[str | int] | None = None):
        self._mujoco = load_mujoco()
        self._scene, self._model = scene, model
        self._geoms: dict[int, Body] = {}
        self._links: dict[int, Body] = {}
        self._meshes: dict[int, Mesh] = {}
        self._pads: dict[Body, tuple[str, int]] = {}
        self.shifts: dict[Body, np.ndarray] = {}
        """The displacements of pads, world [m]."""
        self.hidden: set[int] = set()
        """The ids of broken geoms, which are posed out of reach."""
        chosen = self._collision_geoms() if geoms is None else [self._id("geom", geom) for geom in geoms]
        for geom in chosen:
            self._geoms[geom] = body = scene.add_body(self._shape(geom), name=self._name("geom", geom))
            object.__setattr__(body, "skeleton", skeleton(model, geom))

    # -- naming -----------------------------------------------------------------------------------------------------

    def geom(self, which: str | int) -> Body:
        """Return the body of a geom, to put a skin on or to track.

        Raises:
            SceneError: there is no such geom, or it was not added.
        """
        found = self._id("geom", which)
        if found not in self._geoms:
            raise SceneError(f"geom {which!r} is not in the scene (geoms: {self._listed(self._geoms)})")
        return self._geoms[found]

    def link(self, which: str | int) -> Body:
        """Return a frame that follows a MuJoCo body, to put a skin on. Call it before the scene is built.

        Such a skin also touches the geoms of its own body, unless ``ignore`` names them: see :meth:`geoms_of`.
        """
        found = self._id("body", which)
        if found not in self._links:
            self._links[found] = self._scene.add_body(name=f"{self._name('body', found)} (frame)")
        return self._links[found]

    def pad(self, which: str, name: str) -> Body:
        """Return a new frame that follows a geom or MuJoCo body and can be displaced: see :attr:`shifts`."""
        kind = "GEOM" if self.has("geom", which) else "BODY"
        body = self._scene.add_body(name=f"{name} (pad)")
        self._pads[body] = kind, self._id(kind.lower(), which)
        return body

    def place(self, data: Any, pad: Body) -> tuple[np.ndarray, np.ndarray]:
        """Return a pad's position without displacement and its orientation, a matrix, by the last kinematics."""
        kind, index = self._pads[pad]
        if kind == "GEOM":
            return data.geom_xpos[index], data.geom_xmat[index].reshape(3, 3)
        return data.xpos[index], data.xmat[index].reshape(3, 3)

    def body_of(self, name: str) -> Body:
        """Return the body that carries a skin on the geom or MuJoCo body of this name.

        Raises:
            SceneError: there is neither a geom nor a body of this name.
        """
        self.check(name)
        return self.geom(name) if self.has("geom", name) else self.link(name)

    def check(self, name: str) -> None:
        """Raise :class:`SceneError` if there is neither a geom nor a MuJoCo body of this name."""
        if not self.has("geom", name) and not self.has("body", name):
            raise SceneError(f"engine: no geom or body {name!r}; {self.names()}")

    def has(self, kind: str, name: str) -> bool:
        """Return True if the model has an element of this kind (``geom``, ``body``, ``joint``) and name."""
        return self._mujoco.mj_name2id(self._model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name) >= 0

    @property
    def bodies(self) -> list[Body]:
        """All bodies that were added to the scene."""
        return [*self._geoms.values(), *self._links.values(), *self._pads]

    @property
    def geoms(self) -> dict[int, Body]:
        """The bodies of geoms, by the geoms' ids."""
        return dict(self._geoms)

    def names(self) -> str:
        """Return the names of geoms and bodies, for a message."""
        return f"geoms: {self._listed(self._geoms)}; bodies: {self._names('body', range(self._model.nbody))}"

    def geoms_of(self, which: str | int) -> list[Body]:
        """Return the bodies of all geoms that a MuJoCo body carries."""
        found = self._id("body", which)
        return [body for geom, body in self._geoms.items() if self._model.geom_bodyid[geom] == found]

    @property
    def free_bodies(self) -> dict[str, int]:
        """The index of each free MuJoCo body's first number in a row of ``qpos``, by the body's name."""
        model = self._model
        free = np.flatnonzero(model.jnt_type == self._mujoco.mjtJoint.mjJNT_FREE)
        return {self._name("body", int(model.jnt_bodyid[k])): int(model.jnt_qposadr[k]) for k in free}

    def column(self, name: str) -> int:
        """Return the index of the first number of a joint, or of a free body, in a row of ``qpos``.

        Raises:
            SceneError: there is neither a joint nor a free body of this name.
        """
        if self.has("joint", name):
            return int(self._model.joint(name).qposadr[0])
        if name in (free := self.free_bodies):
            return free[name]
        joints = self._names("joint", range(self._model.njnt))
        raise SceneError(f"no joint or free body {name!r} in the MuJoCo model (joints: {joints}; free: {list(free)})")

    def root(self, name: str) -> str:
        """Return the name of the root MuJoCo body under a geom or body of this name.

        Raises:
            SceneError: there is neither a geom nor a body of this name.
        """
        self.check(name)
        model = self._model
        body = int(model.geom(name).bodyid[0]) if self.has("geom", name) else model.body(name).id
        return self._name("body", int(model.body_rootid[body]))

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on a geom or MuJoCo body ignores.

        These are the geoms that move with it, and those that MuJoCo lets none of them touch.
        """
        mine = self.moving_with(name)
        touched = {
            int(geom)
            for geom in self._geoms
            if geom not in mine and (not len(mine) or any(self.may_touch(int(own), int(geom)) for own in mine))
        }
        return tuple(body.index for geom, body in self._geoms.items() if geom not in touched)

    def moving_with(self, name: str) -> np.ndarray:
        """Return the ids of the geoms that move with a geom or MuJoCo body and take part in collisions."""
        model = self._model
        body = int(model.geom(name).bodyid[0]) if self.has("geom", name) else model.body(name).id
        together = model.body_weldid[model.geom_bodyid] == model.body_weldid[body]
        if model.body_weldid[body] == 0:  # of a static body only its own geoms count
            together = model.geom_bodyid == body
        return np.flatnonzero(together & ((model.geom_contype != 0) | (model.geom_conaffinity != 0)))

    def may_touch(self, a: int, b: int) -> bool:
        """Return True if MuJoCo lets two geoms touch."""
        model = self._model
        types, affinities = model.geom_contype, model.geom_conaffinity
        if not (types[a] & affinities[b] or types[b] & affinities[a]):
            return False
        one, other = (int(model.body_weldid[model.geom_bodyid[geom]]) for geom in (a, b))
        parents = [int(model.body_weldid[model.body_parentid[body]]) for body in (one, other)]
        if one and other and (parents[0] == other or parents[1] == one):
            return False
        bodies = sorted(int(model.geom_bodyid[geom]) for geom in (a, b))
        return (bodies[0] << 16) + bodies[1] not in model.exclude_signature

    def _id(self, kind: str, which: str | int) -> int:
        table = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        count = getattr(self._model, f"n{kind}")
        found = self._mujoco.mj_name2id(self._model, table, which) if isinstance(which, str) else int(which)
        if not 0 <= found < count:
            known = [self._name(kind, index) for index in range(count)]
            plural = "bodies" if kind == "body" else ""
            raise SceneError(f"the MuJoCo model has {no_such(kind, which, known, plural)}")
        return found

    def _name(self, kind: str, index: int) -> str:
        table = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        return self._mujoco.mj_id2name(self._model, table, index) or f"{kind}{index}"

    def _names(self, kind: str, indices: Iterable[int]) -> str:
        return ", ".join(self._name(kind, index) for index in indices)

    def _listed(self, geoms: Iterable[int]) -> str:
        return self._names("geom", geoms) or "none"

    # -- shapes -----------------------------------------------------------------------------------------------------

    def _collision_geoms(self) -> list[int]:
        takes_part = (self._model.geom_contype != 0) | (self._model.geom_conaffinity != 0)
        return [int(geom) for geom in np.flatnonzero(takes_part)]

    def _shape(self, geom: int) -> Shape:
        size = [float(value) for value in self._model.geom_size[geom]]
        kind = self._mujoco.mjtGeom(self._model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        if kind == "mesh":
            return self._mesh(int(self._model.geom_dataid[geom]))
        if (shape := shape_of(kind, size)) is not None:
            return shape
        raise SceneError(
            f"geom {self._name('geom', geom)!r} is of kind {kind}, which is not supported; "
            "name the other geoms to add: MujocoSource(scene, model, geoms=[...])"
        )

    def _mesh(self, mesh: int) -> Mesh:
        """Return a mesh in MuJoCo's form: centred, in the geom's frame. MuJoCo itself collides its convex hull."""
        if mesh not in self._meshes:
            m = self._model
            first, count = m.mesh_vertadr[mesh], m.mesh_vertnum[mesh]
            start, faces = m.mesh_faceadr[mesh], m.mesh_facenum[mesh]
            vertices = m.mesh_vert[first : first + count].astype(np.float64)
            self._meshes[mesh] = Mesh(source=(vertices, m.mesh_face[start : start + faces].copy()))
        return self._meshes[mesh]

    # -- poses ------------------------------------------------------------------------------------------------------

    def update(self, sim: Simulation, data: Any | Sequence[Any]) -> None:
        """Pose all bodies by MuJoCo's present configuration.

        Kinematics are computed first, since ``mj_step`` leaves them at the configuration before the step.

        Args:
            sim: the built scene.
            data: an ``mujoco.MjData``, or one per environment.
        """
        per_env = list(data) if isinstance(data, Sequence) else [data]
        if len(per_env) not in (1, sim.n_envs):
            raise SceneError(f"MujocoSource.update: expected 1 or {sim.n_envs} MjData, got {len(per_env)}")
        for one in per_env:
            self._refresh(one, sim._uses_velocity)
        rows = np.stack([self._rows(one, sim._uses_velocity) for one in per_env], axis=1)
        sim._world.put_all(self._places, rows)

    def bind(self, sim: Simulation, data: Any) -> None:
        """Bind the scene's poses to MuJoCo Warp's data, which are read at each step on the device.

        They are those of its last kinematics, which MuJoCo Warp computes *before* it integrates a step.

        Args:
            sim: the built scene, of as many environments as ``data`` has worlds.
            data: a ``mujoco_warp.Data`` on the simulation's device.
        """
        model = self._model
        index = {body: int(model.geom_bodyid[geom]) for geom, body in self._geoms.items()}
        index |= {body: link for link, body in self._links.items()}
        velocities: dict[str, Any] = {}
        if sim._uses_velocity:
            velocities = {"linear_velocity": (data.cvel, 3), "angular_velocity": (data.cvel, 0)}
            velocities |= {"velocity_at": data.subtree_com, "velocity_at_index": model.body_rootid}
        offsets = {body: (model.geom_pos[geom], model.geom_quat[geom]) for geom, body in self._geoms.items()}
        sim.bind_poses(position=data.xpos, quaternion=data.xquat, index=index, offsets=offsets, **velocities)

    def _refresh(self, data: Any, velocities: bool) -> None:
        self._mujoco.mj_kinematics(self._model, data)
        if velocities:
            self._mujoco.mj_comPos(self._model, data)
            self._mujoco.mj_comVel(self._model, data)

    @cached_property
    def _places(self) -> np.ndarray:
        """The indices in the scene of all bodies that were added."""
        return np.array([body.index for body in self.bodies])

    @cached_property
    def _followed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The index of each added body among MuJoCo's bodies and then geoms, its MuJoCo body and rotation on it."""
        model, on = self._model, [("GEOM", geom) for geom in self._geoms] + [("BODY", link) for link in self._links]
        on += self._pads.values()
        of_geom = np.array([kind == "GEOM" for kind, _ in on])
        index = np.array([each for _, each in on], int)
        geoms = np.where(of_geom, index, 0)
        return (
            np.where(of_geom, model.nbody + index, index),
            np.where(of_geom, model.geom_bodyid[geoms], index),
            np.where(of_geom[:, None], model.geom_quat[geoms], rotation.IDENTITY),
        )

    def _rows(self, data: Any, velocities: bool) -> np.ndarray:
        """Return position, quaternion, linear and angular velocity of all bodies that were added, ``(n, 13)``."""
        places, bodies, turns = self._followed
        rows = np.zeros((len(bodies), 13))
        position = np.concatenate([data.xpos, data.geom_xpos])[places]
        if velocities:
            arm = position - data.subtree_com[self._model.body_rootid[bodies]]
            rows[:, 10:] = data.cvel[bodies, :3]
            rows[:, 7:10] = data.cvel[bodies, 3:] + rotation.cross_many(rows[:, 10:], arm)
        for k, body in enumerate(self._pads, len(rows) - len(self._pads)):
            if body in self.shifts:
                position[k] += self.shifts[body]
        for k, geom in enumerate(self._geoms):
            if geom in self.hidden:
                position[k] = _AWAY
        rows[:, :3], rows[:, 3:7] = position, rotation.multiply_many(data.xquat[bodies], turns)
        return rows
