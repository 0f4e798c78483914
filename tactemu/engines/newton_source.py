"""The shapes of a Newton model as bodies of a scene, posed from Newton's state on the device.

::

    builder.add_mjcf("hand.xml")
    worlds = newton.ModelBuilder()
    worlds.replicate(builder, 4096)
    model = worlds.finalize(device="cuda:0")
    scene = tt.Scene(dt=4e-3)
    source = tt.NewtonSource(scene, model)
    skin = scene.add_sensor(tt.KinematicTaxel(...), link=source.shape("fingertip"))
    sim = scene.build(4096, device="cuda:0")
    source.bind(sim, state)
    while True:
        solver.step(state, state, control, contacts, 4e-3)
        sim.step()

Newton computes the motion and the contact forces; the skin's readings follow from the poses and velocities of the
shapes. It needs the extra ``tactemu[newton]``.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.base.errors import SceneError, nearest
from tactemu.engines.mujoco_source import shape_of
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.shapes.mesh import Mesh
from tactemu.geometry.shapes.shape import Shape

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation

MESHES = ("mesh", "convex_mesh")
"""The kinds of shapes that are meshes."""
COLLIDES = 1 << 1
"""The flag ``newton.ShapeFlags.COLLIDE_SHAPES``."""


class NewtonSource:
    """The colliding shapes of one world of a Newton model in a scene, posed from Newton's state.

    The name of a shape or body is the last part of its label, or the full label where the last part is not unique.

    Args:
        scene: the scene in which the shapes become bodies.
        model: a ``newton.Model`` whose worlds are alike.

    Raises:
        SceneError: the worlds are not alike, or the kind of a shape is not supported.
    """

    def __init__(self, scene: Scene, model: Any):
        self.model = model
        """The ``newton.Model``."""
        self._scene = scene
        self._n_worlds = max(1, model.world_count)
        if model.body_count % self._n_worlds or (self._n_worlds > 1 and (model.body_world.numpy() < 0).any()):
            raise SceneError(
                f"NewtonSource: {model.body_count} bodies in {self._n_worlds} worlds: expected the same bodies in each"
            )
        self._n_bodies = model.body_count // self._n_worlds
        joints = list(model.joint_label[: model.joint_count // self._n_worlds])
        bodies = list(model.body_label[: self._n_bodies])
        self._labels = {"body": bodies, "joint": joints, "shape": list(model.shape_label)}
        self._on = model.shape_body.numpy()
        self._places = model.shape_transform.numpy().astype(np.float64)
        mine = (model.shape_world.numpy() <= 0) & ((model.shape_flags.numpy() & COLLIDES) != 0)
        self._shapes: dict[int, Body] = {}
        self._links: dict[int, Body] = {}
        for shape in map(int, np.flatnonzero(mine)):
            place, turn = self._place(shape)
            fixed = self._on[shape] < 0
            self._shapes[shape] = scene.add_body(
                self._shape_of(shape),
                name=self._name("shape", shape),
                fixed=fixed,
                position=tuple(place) if fixed else (0.0, 0.0, 0.0),
                quaternion=tuple(turn) if fixed else rotation.IDENTITY,
            )

    # -- naming ------------------------------------------------------------------------------------------------------

    def shape(self, which: str) -> Body:
        """Return the body of a shape, to put a skin on or to track.

        Raises:
            SceneError: there is no colliding shape of this name.
        """
        found = self._find("shape", which)
        if found is None or found not in self._shapes:
            raise SceneError(f"no shape {which!r} in the Newton model{self._hint(which)}")
        return self._shapes[found]

    def link(self, which: str) -> Body:
        """Return a frame that follows a Newton body, to put a skin on. Call it before the scene is built.

        Raises:
            SceneError: there is no such body.
        """
        found = self._find("body", which)
        if found is None:
            raise SceneError(f"no body {which!r} in the Newton model{self._hint(which)}")
        if found not in self._links:
            self._links[found] = self._scene.add_body(name=f"{self._name('body', found)} (frame)")
        return self._links[found]

    def body_of(self, name: str) -> Body:
        """Return the body that carries a skin on the shape or Newton body of this name.

        Raises:
            SceneError: there is neither a shape nor a body of this name.
        """
        return self.link(name) if self._find("shape", name) is None else self.shape(name)

    @property
    def free_bodies(self) -> dict[str, int]:
        """The index of each free Newton body's first number in a row of ``joint_q``, by the body's name."""
        import newton

        free = np.flatnonzero(self.model.joint_type.numpy()[: len(self._labels["joint"])] == newton.JointType.FREE)
        children, starts = self.model.joint_child.numpy(), self.model.joint_q_start.numpy()
        return {self._short("body", int(children[k])): int(starts[k]) for k in free}

    def column(self, name: str) -> int:
        """Return the index of the first number of a joint, or of a free body, in a row of ``joint_q``.

        Raises:
            SceneError: there is neither a joint nor a free body of this name.
        """
        joint = self._find("joint", name)
        if joint is not None:
            return int(self.model.joint_q_start.numpy()[joint])
        if name in (free := self.free_bodies):
            return free[name]
        joints = ", ".join(self._short("joint", k) for k in range(len(self._labels["joint"])))
        raise SceneError(f"no joint or free body {name!r} in the Newton model (joints: {joints}; free: {list(free)})")

    def root(self, name: str) -> str:
        """Return the name of the root Newton body under a shape or body of this name; it is empty for the world.

        Raises:
            SceneError: there is neither a shape nor a body of this name.
        """
        shape = self._find("shape", name)
        body = self._find("body", name) if shape is None else int(self._on[shape])
        if body is None:
            raise SceneError(f"no shape or body {name!r} in the Newton model{self._hint(name)}")
        top = self._above(body)
        return "" if top < 0 else self._short("body", top)

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on a shape or Newton body ignores.

        These are the shapes that move with it, those that Newton lets none of them touch, and those on the other side
        of its joint or of a joint on it.
        """
        shape = self._find("shape", name)
        body = int(self._on[shape]) if shape is not None else self._find("body", name)
        group = -1 if body is None else self._above(body, welded=True)
        groups = {k: self._above(int(self._on[k]), welded=True) for k in self._shapes}
        mine = {k for k, each in groups.items() if each == group}
        beside = {k for k, each in groups.items() if each in self._jointed(group) or group in self._jointed(each)}
        apart = {frozenset(pair) for pair in self.model.shape_collision_filter_pairs}
        others = [k for k in self._shapes if k not in mine | beside]
        touched = {k for k in others if not all(frozenset((k, own)) in apart for own in mine)}
        if not mine:
            touched = set(self._shapes)
        return tuple(self._shapes[k].index for k in self._shapes if k not in touched)

    @property
    def bodies(self) -> list[Body]:
        """All bodies that were added to the scene."""
        return [*self._shapes.values(), *self._links.values()]

    def _find(self, kind: str, name: str) -> int | None:
        labels = self._labels[kind]
        known = self._shapes if kind == "shape" else range(len(labels))
        found = [k for k in known if name in (labels[k], labels[k].rpartition("/")[2])]
        exact = [k for k in found if labels[k] == name]
        return exact[0] if exact else found[0] if len(found) == 1 else None

    def _name(self, kind: str, index: int) -> str:
        label = self._labels[kind][index]
        short = label.rpartition("/")[2]
        return short if self._find(kind, short) in (index, None) and not self._taken(short) else label

    def _short(self, kind: str, index: int) -> str:
        """Return the last part of a label if it is unique, else the full label."""
        label = self._labels[kind][index]
        short = label.rpartition("/")[2]
        return short if self._find(kind, short) == index else label

    def _above(self, body: int, *, welded: bool = False) -> int:
        """Return the root body under this one, along all joints, or with ``welded`` only along fixed joints."""
        while (joint := self._held_by.get(body)) is not None and (joint[1] or not welded):
            body = joint[0]
        return body

    def _jointed(self, group: int) -> tuple[int, ...]:
        """Return the group to which a group of welded bodies is jointed, unless it is static.

        MuJoCo does not let the two touch.
        """
        if group not in self._held_by:
            return ()
        parent = self._above(self._held_by[group][0], welded=True)
        return () if parent in self._still else (parent,)

    @cached_property
    def _joints(self) -> list[tuple[int, int, bool]]:
        """Each body, its parent, and whether they are welded, without the joints that close a loop, which come last."""
        import newton

        model = self.model
        rows = zip(*(each.numpy().tolist() for each in (model.joint_child, model.joint_parent, model.joint_type)))
        first: dict[int, tuple[int, int, bool]] = {}
        for child, parent, kind in rows:
            first.setdefault(child, (child, parent, kind == newton.JointType.FIXED))
        return list(first.values())

    @cached_property
    def _held_by(self) -> dict[int, tuple[int, bool]]:
        """The parent of each body that has one, and whether they are welded."""
        return {child: (parent, welded) for child, parent, welded in self._joints if parent >= 0}

    @cached_property
    def _still(self) -> set[int]:
        """The bodies that are welded to the world."""
        return {child for child, parent, welded in self._joints if parent < 0 and welded}

    def _taken(self, name: str) -> bool:
        return any(body.name == name for body in self._scene.bodies)

    def _hint(self, which: str) -> str:
        shapes = [body.name for body in self._shapes.values()]
        bodies = [self._name("body", k) for k in range(self._n_bodies)]
        return f"{nearest(which, shapes + bodies)} (shapes: {', '.join(shapes)}; bodies: {', '.join(bodies)})"

    # -- shapes ------------------------------------------------------------------------------------------------------

    def _place(self, shape: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the position and quaternion (w, x, y, z) of a shape on its body."""
        row = self._places[shape]
        return row[:3], row[[6, 3, 4, 5]]

    def _shape_of(self, shape: int) -> Shape:
        model = self.model
        kind = _kinds()[int(model.shape_type.numpy()[shape])]
        size = [float(value) for value in model.shape_scale.numpy()[shape]]
        if kind in MESHES:
            source = model.shape_source[shape]
            vertices = np.asarray(source.vertices, np.float64) * size
            return Mesh(source=(vertices, np.asarray(source.indices).reshape(-1, 3)))
        if (found := shape_of(kind, size)) is None:
            raise SceneError(f"shape {self._labels['shape'][shape]!r} is of kind {kind}, which is not supported")
        return found

    # -- poses -------------------------------------------------------------------------------------------------------

    def bind(self, sim: Simulation, state: Any) -> None:
        """Bind the scene's poses to Newton's state, which is read at each step on the device.

        Args:
            sim: the built scene, of as many environments as the state has worlds.
            state: a ``newton.State`` on the simulation's device.
        """
        if state.body_q is None or state.body_q.shape[0] != sim.n_envs * self._n_bodies:
            got = 0 if state.body_q is None else state.body_q.shape[0]
            raise SceneError(
                f"NewtonSource.bind: the state has {got} bodies; expected {sim.n_envs * self._n_bodies} "
                f"({sim.n_envs} environments of {self._n_bodies})"
            )
        carried = {k: body for k, body in self._shapes.items() if self._on[k] >= 0}
        index = {body: int(self._on[k]) for k, body in carried.items()} | {b: k for k, b in self._links.items()}
        velocities: dict[str, Any] = {}
        if sim._uses_velocity:
            velocities = {"linear_velocity": (state.body_qd, 0), "angular_velocity": (state.body_qd, 3)}
            com = self.model.body_com.numpy()[: self._n_bodies].astype(np.float64)
            velocities |= {"velocity_at": "com", "com": com}
        sim.bind_poses(
            position=(state.body_q, 0),
            quaternion=(state.body_q, 3),
            order="xyzw",
            index=index,
            offsets={body: self._place(k) for k, body in carried.items()},
            **velocities,
        )


def _kinds() -> dict[int, str]:
    """Return the names of Newton's kinds of shapes, which equal MuJoCo's names if MuJoCo has the kind."""
    import newton

    return {int(kind): kind.name.lower() for kind in newton.GeoType}
