"""The scene in three dimensions: bodies and hands, on them boards of taxels, below them the ground."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from typing import Any

import numpy as np
import trimesh
import viser

from tactemu.geometry import rotation
from tactemu.scene.description import BodyDescription, PartDescription
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import pitch
from tactemu.view.conversions.taxel_tables import WORLD, parts_of
from tactemu.view.page.boards import Board
from tactemu.view.page.camera import direction
from tactemu.view.page.feed import DescribedRun, PageState
from tactemu.view.page.ground import Ground, round_length
from tactemu.view.page.hands import hand
from tactemu.view.page.legend import Row, style
from tactemu.view.page.lights import add_lights, lit_model, mesh_colour
from tactemu.view.page.ranges import NO_CONTACT, Ranges
from tactemu.view.page.shapes import Mesh, capsule, joined, rounded

_GREY = (0.74, 0.77, 0.81)
"""The colour of bodies that viewers cannot move."""
_BLUE = (0.45, 0.68, 0.90)
"""The colour of bodies that viewers can drag."""
_OPACITY = 0.28
"""The opacity of bodies without taxels, through which one sees the taxels that they press."""
_PLANE_M = 0.3
_ARROW_PITCHES = 4.0
"""The longest arrow [pitches], rounded down to a length that one can count on the grid."""
_MAX_SEEN = 600
"""Maximum number of taxels that the camera considers."""
_SHADOW_POINTS = 15_000
"""Number of points on the surfaces that throw shadows."""


class Scene:
    """The drawing of one emulator's scene.

    Args:
        server: viser's server; its present scene is removed.
        run: the bodies and skins of the emulator.
        movable: names of the bodies that viewers can drag.
    """

    def __init__(self, server: viser.ViserServer, run: DescribedRun, movable: Collection[str] = ()):
        self._run, self._movable = run, movable
        scene = server.scene
        scene.reset()
        scene.set_up_direction("+z")
        add_lights(scene)
        self.frames: dict[str, Any] = {WORLD: scene.add_frame("/world", show_axes=False)}
        self.solids: dict[str, Any] = {}
        """The mesh of each body that a viewer can drag."""
        self.labels: dict[str, Any] = {}
        self._poses = {WORLD: (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
        self._surfaces: dict[str, np.ndarray] = {}
        parts = [(name, part) for name, skin in run.skins.items() for part in _parts(run, name, len(skin.layout))]
        self._on = {
            part.name: part.body if part.body in {b.name for b in run.scene.bodies} else WORLD for _, part in parts
        }
        hands = {self._on[part.name]: found for name, part in parts if (found := self._hand(name, part)) is not None}
        carriers = {self._on[part.name] for _, part in parts}
        for body in run.scene.bodies:
            self._add_body(scene, body, is_carrier=body.name in carriers, has_hand=body.name in hands)
        for body, mesh in hands.items():
            self._add_hand(scene, body, mesh)
        self.ranges = Ranges(run)
        pitches = [pitch(part) for _, part in parts] or [1e-3]
        self._arrow_m = round_length(_ARROW_PITCHES * float(np.median(pitches)))
        on = lambda pair: self._on[pair[1].name]  # noqa: E731
        taxels = sum(len(part.taxels) for _, part in parts)
        patches = {name: skin.described.patches for name, skin in run.skins.items()}
        self.boards = {
            body: Board(scene, self.frames[body].name, list(group), patches, arrow_m=self._arrow_m, taxels=taxels)
            for body, group in itertools.groupby(sorted(parts, key=on), key=on)
        }
        self._ground: Ground | None = None
        self._scene = scene
        self._vectors: set[str] = set()

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _hand(self, skin: str, part: PartDescription) -> Mesh | None:
        """Return the outline of a hand around a part that has patches on several fingers, in the frame of its body."""
        taxels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for patch in self._run.skins[skin].described.patches:
            here = (part.taxels >= patch.start) & (part.taxels < patch.start + len(patch))
            taxels[patch.name] = part.positions[here], part.normals[here]
        mesh = hand(taxels)
        if mesh is None:
            return None
        turn = rotation.normalised(part.quaternion)
        return Mesh(rotation.rotate(turn, mesh.vertices) + part.position, mesh.faces)

    def _add_hand(self, scene: viser.SceneApi, body: str, mesh: Mesh) -> None:
        model = lit_model(mesh, _GREY)
        scene.add_glb(f"{self.frames[body].name}/hand", model, cast_shadow=False, receive_shadow=False)
        self._surfaces[body] = _spread(mesh, _SHADOW_POINTS // 2)

    def _add_body(self, scene: viser.SceneApi, body: BodyDescription, *, is_carrier: bool, has_hand: bool) -> None:
        path = f"/bodies/{body.name.replace('/', '∕')}"
        position, quaternion = np.array(body.position), np.array(body.quaternion)
        self.frames[body.name] = scene.add_frame(path, show_axes=False, position=position, wxyz=quaternion)
        self._poses[body.name] = position, quaternion
        mesh = None if has_hand else _mesh(body)
        if mesh is not None:
            is_solid = is_carrier or body.skeleton is not None
            self._add_shape(scene, f"{path}/shape", mesh, body, is_solid=is_solid)
            if body.shape != "plane":
                self._surfaces[body.name] = _spread(mesh, max(100, _SHADOW_POINTS // len(self._run.scene.bodies)))
        if body.points:
            red, green, blue = (round(255 * part) for part in body.points.color[:3])
            scene.add_point_cloud(
                f"{path}/points", body.points.positions.astype(np.float32),
                (red, green, blue), point_size=2 * body.points.radius, point_shape="circle",
            )  # fmt: skip
        reach = 1.1 * _reach(body)
        self.labels[body.name] = scene.add_label(f"{path}/label", "", position=(0.0, 0.0, reach), visible=False)

    def _add_shape(
        self, scene: viser.SceneApi, path: str, mesh: Mesh, body: BodyDescription, *, is_solid: bool
    ) -> None:
        is_movable = body.name in self._movable
        colour, opacity = _BLUE if is_movable else _GREY, 1.0 if is_solid else _OPACITY
        if body.skeleton is None:
            solid = scene.add_glb(path, lit_model(mesh, colour, opacity), cast_shadow=False, receive_shadow=False)
        else:  # links turn, and with them light that is in their colours
            solid = scene.add_mesh_simple(
                path, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), color=mesh_colour(colour),
                opacity=None if is_solid else _OPACITY, cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        if is_movable:
            self.solids[body.name] = solid

    # -- what viewers see ----------------------------------------------------------------------------------------------

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the points that a camera should show, and the direction from them to it: the taxels, hands, and the
        bodies near them."""
        points, normals = [], []
        for body, board in self.boards.items():
            every = max(1, len(board.positions) // _MAX_SEEN)
            points.append(self._world(body, board.positions[::every]))
            normals.append(rotation.rotate(self._poses[body][1], board.normals[::every]))
        skin = np.concatenate(points) if points else np.zeros((0, 3))
        low, high = (skin.min(axis=0), skin.max(axis=0)) if len(skin) else (np.full(3, -np.inf), np.full(3, np.inf))
        extent = max(float(np.linalg.norm(high - low)), 0.01)
        for body, surface in self._surfaces.items():
            at = self._world(body, surface)
            gap = np.maximum(np.maximum(low - at, at - high), 0.0)
            is_near = float(np.linalg.norm(gap, axis=1).min()) < 0.5 * extent
            if body in self.boards or (is_near and float(np.ptp(at, axis=0).max()) < 2.5 * extent):
                points.append(at)
        towards = direction(np.concatenate(normals)) if normals else direction(np.zeros((0, 3)))
        return (np.concatenate(points) if points else 0.05 * np.array([[-1.0, -1, -1], [1, 1, 1]])), towards

    def _world(self, body: str, points: np.ndarray) -> np.ndarray:
        position, quaternion = self._poses[body]
        return rotation.rotate(quaternion, points) + position

    def draw(self, state: PageState) -> None:
        """Show a state: move the bodies, colour the taxels, and draw the shadows."""
        for name, body in state.bodies.items():
            frame = self.frames.get(name)
            if frame is not None:
                self._poses[name] = np.asarray(body["position"], float), np.asarray(body["quaternion"], float)
                _set_pose(frame, *self._poses[name])
        self.ranges.include(state.samples)
        for skin, sample in state.samples.items():
            if skin in self._run.skins and np.shape(sample.measured)[1:] == (3,):
                self._vectors.add(self.ranges.of(skin, sample.sense).quantity)
        for board in self.boards.values():
            board.draw(state.samples, self.ranges)
        if self._ground is None:
            self._ground = self._make_ground()
        self._ground.draw(self._poses)

    def _make_ground(self) -> Ground:
        """Return the ground, once the poses of all bodies are known."""
        planes = [
            self._poses[body.name][0][2]
            for body in self._run.scene.bodies
            if body.shape == "plane" and abs(self._poses[body.name][1][0]) > 1 - 1e-6
        ]
        points, _ = self.seen()
        return Ground(self._scene, self._surfaces, [points], max(planes, default=None))

    def legend(self) -> str:
        """Return the style sheet with the legend of the scene."""
        rows = []
        for scale in self.ranges:
            end = scale.end()
            arrow = f"{self._arrow_m * 1e3:.3g} mm = {end}" if scale.quantity in self._vectors and end else ""
            rows.append(Row(f"measured {scale.quantity} of a taxel", end or NO_CONTACT, scale.half(), arrow))
        grid = f"grid {self._ground.step * 1e3:g} mm" if self._ground else ""
        return style(rows[:3], grid)


def _parts(run: DescribedRun, skin: str, taxels: int) -> list[PartDescription]:
    nothing = np.zeros(taxels)
    return parts_of(run.scene, Sample(0, skin, nothing, nothing, nothing)) if taxels else []


def _set_pose(frame: Any, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Set the pose of a frame only if it has changed, because viser sends every assignment to the viewers."""
    if not np.array_equal(frame.position, position):
        frame.position = position
    if not np.array_equal(frame.wxyz, quaternion):
        frame.wxyz = quaternion


def _reach(body: BodyDescription) -> float:
    """Return an approximate radius of a body around its origin [m]."""
    outline = body.outline
    if "vertices" in outline:
        return float(np.linalg.norm(np.array(outline["vertices"], float).reshape(-1, 3), axis=1).max(initial=0.0))
    if "size" in outline:
        return float(np.linalg.norm(outline["size"])) / 2
    return float(outline.get("radius", 0.0)) + float(outline.get("length", 0.0)) / 2


def _mesh(body: BodyDescription) -> Mesh | None:
    """Return the mesh of a body, in its frame, with the capsules between its joints; None if it has no shape."""
    mesh = _shape(body)
    if mesh is None or not body.skeleton:
        return mesh
    radius = 0.45 * float(np.ptp(mesh.vertices, axis=0).min())
    return joined([mesh, *(capsule(np.array(line[:3]), np.array(line[3:]), radius) for line in body.skeleton)])


def _shape(body: BodyDescription) -> Mesh | None:
    outline = body.outline
    if "faces" in outline:
        return Mesh(np.array(outline["vertices"], float).reshape(-1, 3), np.array(outline["faces"]).reshape(-1, 3))
    if body.shape == "box":
        half = np.array(outline["size"], float) / 2
        return rounded(half, 0.22 * float(half.min()))
    if body.shape == "plane":
        return rounded((_PLANE_M / 2, _PLANE_M / 2, 5e-5), 1e-5).moved(np.eye(3), np.array([0.0, 0.0, -5e-5]))
    if body.shape == "sphere":
        ball = trimesh.creation.icosphere(subdivisions=3, radius=outline["radius"])
        return Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    if body.shape == "capsule":
        end = np.array([0.0, 0.0, outline["length"] / 2])
        return capsule(-end, end, outline["radius"], 6)
    if body.shape == "cylinder":
        mesh = trimesh.creation.cylinder(radius=outline["radius"], height=outline["length"])
        return Mesh(np.asarray(mesh.vertices - mesh.bounds.mean(axis=0)), np.asarray(mesh.faces))
    return None


def _spread(mesh: Mesh, count: int) -> np.ndarray:
    """Return points that are spread evenly over a mesh, always the same ones."""
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not areas.sum():
        return mesh.vertices[:1]
    random = np.random.default_rng(0)
    chosen = random.choice(len(corners), count, p=areas / areas.sum())
    a, b = np.sort(random.random((2, count, 1)), axis=0)
    return corners[chosen, 0] * a + corners[chosen, 1] * (b - a) + corners[chosen, 2] * (1 - b)
