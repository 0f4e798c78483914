"""The scene in three dimensions: bodies, and on them taxels, forces, probes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from tactemu.base.style import colours
from tactemu.geometry import rotation
from tactemu.scene.description import BodyDescription, PartDescription
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import in_contact, pitch
from tactemu.view.conversions.taxel_tables import WORLD, parts_of
from tactemu.view.page.feed import DescribedRun, PageState, magnitudes

_GREY = (150, 155, 168)
"""The colour of bodies that viewers cannot move."""
_BLUE = (96, 150, 200)
"""The colour of bodies that viewers can drag."""
_PLANE_M = 0.3
_MAX_ARROW_PITCHES = 3.0
"""Length of the arrow of the largest force so far [pitches]."""
_MAX_ARROWS = 400
"""Maximum number of arrows on a body: the largest forces are drawn."""
_DISC_SIDES = 12
"""Number of sides of a taxel's disc."""
_MIN_HEXAGON_TAXELS = 1000
"""Number of taxels from which on they are drawn as hexagons: a machine without a GPU draws each triangle."""


class Scene:
    """The drawing of one emulator's scene.

    Args:
        server: viser's server; its present scene is removed.
        run: the bodies and skins of the emulator.
    """

    def __init__(self, server: viser.ViserServer, run: DescribedRun):
        self._run = run
        scene = server.scene
        scene.reset()
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)
        scene.configure_default_lights(False, cast_shadow=False)
        scene.add_light_ambient("/lights/all", intensity=1.2)
        scene.add_light_directional("/lights/sun", intensity=1.0, position=(0.4, -0.6, 1.0), cast_shadow=False)
        self.frames: dict[str, Any] = {WORLD: scene.add_frame("/world", show_axes=False)}
        self.solids: dict[str, list[Any]] = {}
        """The meshes of each body that a viewer can grab."""
        self.labels: dict[str, Any] = {}
        for body in run.scene.bodies:
            self._add_body(scene, body)
        parts = [(name, part) for name, skin in run.skins.items() for part in _parts(run, name, len(skin.layout))]
        on = lambda pair: pair[1].body if pair[1].body in self.frames else WORLD  # noqa: E731
        fine = sum(len(part.taxels) for _, part in parts) < _MIN_HEXAGON_TAXELS
        self.boards = [
            Board(scene, self.frames[body].name, list(group), fine=fine)
            for body, group in itertools.groupby(sorted(parts, key=on), key=on)
        ]
        self._place_camera(server)

    def _add_body(self, scene: viser.SceneApi, body: BodyDescription) -> None:
        path = f"/bodies/{_path(body.name)}"
        self.frames[body.name] = scene.add_frame(
            path, show_axes=False, position=np.array(body.position), wxyz=np.array(body.quaternion)
        )
        self.solids[body.name] = _solids(scene, path, body)
        if body.points:
            red, green, blue = (round(255 * part) for part in body.points.color[:3])
            scene.add_point_cloud(
                f"{path}/points", body.points.positions.astype(np.float32),
                (red, green, blue), point_size=2 * body.points.radius, point_shape="circle",
            )  # fmt: skip
        reach = _reach(body)
        self.labels[body.name] = scene.add_label(f"{path}/label", "", position=(0.0, 0.0, 1.1 * reach), visible=False)

    def _place_camera(self, server: viser.ViserServer) -> None:
        """Place the camera so that it sees all bodies but endless planes."""
        bodies = [body for body in self._run.scene.bodies if body.shape != "plane"]
        places = [np.array(body.position) for body in bodies] or [np.zeros(3)]
        reaches = [_reach(body) for body in bodies] or [0.05]
        low = np.min([place - reach for place, reach in zip(places, reaches)], axis=0)
        high = np.max([place + reach for place, reach in zip(places, reaches)], axis=0)
        middle, size = (low + high) / 2, max(float(np.linalg.norm(high - low)), 0.01)
        camera = server.initial_camera
        camera.look_at, camera.up = middle, (0.0, 0.0, 1.0)
        camera.position = middle + size * np.array([0.55, -1.1, 0.65])
        camera.near, camera.far = size / 200, size * 50

    def draw(self, state: PageState) -> None:
        """Show a state: move the bodies, and colour the taxels."""
        for name, body in state.bodies.items():
            frame = self.frames.get(name)
            if frame is not None:
                _set_pose(frame, body["position"], body["quaternion"])
        for board in self.boards:
            board.draw(state.samples)


class Board:
    """All taxels on one body: one batched mesh of discs, arrows, and what sensors with ``draw_debug`` show.

    Args:
        scene: viser's scene.
        path: the path of the body in it.
        parts: the parts of skins on the body, each with the name of its skin.
        fine: draw taxels as discs with an edge; else as flat hexagons, a tenth of the work.
    """

    def __init__(
        self, scene: viser.SceneApi, path: str, parts: Sequence[tuple[str, PartDescription]], *, fine: bool = True
    ):
        self._parts = list(parts)
        self._pitches = np.concatenate([np.full(len(part.taxels), pitch(part)) for _, part in parts])
        placed = [_placed(part) for _, part in parts]
        self._positions = np.concatenate([each[0] for each in placed])
        normals = np.concatenate([each[1] for each in placed])
        self.owners = [(skin, int(taxel)) for skin, part in parts for taxel in part.taxels]
        self._most: dict[str, float] = {}
        self._colours = np.zeros((len(self.owners), 3), np.uint8)
        disc = trimesh.creation.cylinder(radius=0.42, height=0.12, sections=_DISC_SIDES) if fine else _hexagon()
        self.discs = scene.add_batched_meshes_simple(
            f"{path}/taxels", disc.vertices, disc.faces, _turned(normals), self._positions,
            batched_scales=self._pitches.astype(np.float32), batched_colors=self._colours, lod="off",
            cast_shadow=False, receive_shadow=False, flat_shading=True,
        )  # fmt: skip
        size = float(np.median(self._pitches)) if len(self._pitches) else 1e-3
        self._arrows = scene.add_arrows(
            f"{path}/forces", np.zeros((1, 2, 3), np.float32), (235, 70, 60), shaft_radius=0.07 * size,
            head_radius=0.2 * size, head_length=0.45 * size, visible=False,
        )  # fmt: skip
        self._probes = [_Probes(scene, f"{path}/{_path(part.name)}", skin, part) for skin, part in parts if part.draw]

    def draw(self, samples: dict[str, Sample]) -> None:
        """Colour the taxels by their measured values, relative to the largest of their skin so far."""
        painted, vectors = [], []
        for skin, part in self._parts:
            sample, n = samples.get(skin), len(part.taxels)
            if sample is None or len(sample.measured) <= part.taxels.max(initial=-1):
                painted.append(np.zeros(n))
                vectors.append(np.zeros((n, 3)))
                continue
            size = magnitudes(sample.measured)
            most = self._most[skin] = max(self._most.get(skin, 0.0), float(np.nanmax(size, initial=0.0)))
            painted.append(size[part.taxels] / (most or 1.0))
            vectors.append(_vectors(sample, part, most))
        now = (255 * colours(np.concatenate(painted))).round().astype(np.uint8)
        if (now != self._colours).any():
            self._colours = self.discs.batched_colors = now
        self._draw_arrows(np.concatenate(vectors))
        for probes in self._probes:
            probes.draw(samples)

    def _draw_arrows(self, vectors: np.ndarray) -> None:
        """Draw the forces as arrows that end at the taxels, because they press from outside."""
        length = np.linalg.norm(vectors, axis=1)
        pressed = np.flatnonzero(length > 0.02)
        if len(pressed) > _MAX_ARROWS:
            pressed = np.argpartition(-length, _MAX_ARROWS)[:_MAX_ARROWS]
        if len(pressed):
            ends = self._positions[pressed]
            ways = vectors[pressed] * (_MAX_ARROW_PITCHES * self._pitches[pressed])[:, None]
            self._arrows.points = np.stack([ends - ways, ends], axis=1).astype(np.float32)
        if self._arrows.visible != bool(len(pressed)):
            self._arrows.visible = bool(len(pressed))


class _Probes:
    """The probes of a sensor with ``draw_debug``: spheres that change their colour in contact."""

    def __init__(self, scene: viser.SceneApi, path: str, skin: str, part: PartDescription):
        assert part.draw is not None
        self._skin, self._part, draw = skin, part, part.draw
        self._probe_colour, self._contact_colour = np.array(draw.probe_color[:3]), np.array(draw.contact_color[:3])
        places, _ = _placed(part, draw.probes)
        n = len(places)
        self._was_in_contact = np.zeros(n, bool)
        ball = trimesh.creation.icosphere(subdivisions=2)
        turns = np.tile((1.0, 0.0, 0.0, 0.0), (n, 1))
        settings: dict[str, Any] = {"lod": "off", "cast_shadow": False, "receive_shadow": False}
        self._balls = [
            scene.add_batched_meshes_simple(
                f"{path}/probes", ball.vertices, ball.faces, turns, places, batched_colors=self._painted(),
                batched_scales=np.full(n, draw.center_radius, np.float32), **settings,
            )
        ]  # fmt: skip
        if draw.opacity:
            self._balls.append(
                scene.add_batched_meshes_simple(
                    f"{path}/radii", ball.vertices, ball.faces, turns, places, batched_colors=self._painted(),
                    batched_scales=draw.radii.astype(np.float32), opacity=draw.opacity, **settings,
                )
            )  # fmt: skip

    def _painted(self) -> np.ndarray:
        return (
            (255 * np.where(self._was_in_contact[:, None], self._contact_colour, self._probe_colour))
            .round()
            .astype(np.uint8)
        )

    def draw(self, samples: dict[str, Sample]) -> None:
        """Colour them by contact."""
        sample = samples.get(self._skin)
        if sample is None or len(sample.ideal) <= self._part.taxels.max(initial=-1):
            return
        now = in_contact(sample)[self._part.taxels]
        if len(now) == len(self._was_in_contact) and (now != self._was_in_contact).any():
            self._was_in_contact = now
            for balls in self._balls:
                balls.batched_colors = self._painted()


def _hexagon() -> trimesh.Trimesh:
    """Return a flat hexagon that is visible from outside only."""
    turns = np.arange(6) * np.pi / 3
    corners = np.stack([0.45 * np.cos(turns), 0.45 * np.sin(turns), np.full(6, 0.06)], axis=1)
    return trimesh.Trimesh(corners, [(0, k, k + 1) for k in range(1, 5)], process=False)


def _parts(run: DescribedRun, skin: str, taxels: int) -> list[PartDescription]:
    nothing = np.zeros(taxels)
    return parts_of(run.scene, Sample(0, skin, nothing, nothing, nothing)) if taxels else []


def _placed(part: PartDescription, positions: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return places and normals in the frame of the body."""
    turn = rotation.normalised(part.quaternion)
    places = part.positions if positions is None else positions
    return rotation.rotate(turn, places) + part.position, rotation.rotate(turn, part.normals)


def _turned(normals: np.ndarray) -> np.ndarray:
    """Return the rotations that take z to the normals, as quaternions (w, x, y, z)."""
    x, y, z = normals.T
    turns = np.stack([1 + z, -y, x, 0 * z], axis=1)
    turns[z < -1 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


def _vectors(sample: Sample, part: PartDescription, most: float) -> np.ndarray:
    """Return the forces on the taxels in the frame of the body, 1 for the largest so far; zeros if readings are no
    vectors."""
    if np.shape(sample.measured)[1:] != (3,) or not most:
        return np.zeros((len(part.taxels), 3))
    values = np.nan_to_num(np.asarray(sample.measured, float)[part.taxels] / most)
    return rotation.rotate(rotation.normalised(part.quaternion), values)


def _set_pose(frame: Any, position: Sequence[float], quaternion: Sequence[float]) -> None:
    """Set the pose of a frame only if it has changed, because viser sends every assignment to the viewers."""
    if not np.array_equal(frame.position, position):
        frame.position = position
    if not np.array_equal(frame.wxyz, quaternion):
        frame.wxyz = quaternion


def _path(name: str) -> str:
    return name.replace("/", "∕")


def _reach(body: BodyDescription) -> float:
    """Return an approximate radius of a body around its origin [m]."""
    outline = body.outline
    if "vertices" in outline:
        return float(np.linalg.norm(np.array(outline["vertices"], float).reshape(-1, 3), axis=1).max(initial=0.0))
    if "size" in outline:
        return float(np.linalg.norm(outline["size"])) / 2
    return float(outline.get("radius", 0.0)) + float(outline.get("length", 0.0)) / 2


def _solids(scene: viser.SceneApi, path: str, body: BodyDescription) -> list[Any]:
    """Return the meshes of a body, in its frame."""
    outline, name = body.outline, f"{path}/shape"
    look: dict[str, Any] = {"color": _GREY, "opacity": 0.55, "cast_shadow": False, "receive_shadow": False}
    if "faces" in outline:
        vertices, faces = np.array(outline["vertices"], np.float32), np.array(outline["faces"], np.uint32)
        return [scene.add_mesh_simple(name, vertices, faces, side="double", **look)]
    if body.shape == "box":
        return [scene.add_box(name, dimensions=tuple(outline["size"]), **look)]
    if body.shape == "plane":
        return [scene.add_box(name, dimensions=(_PLANE_M, _PLANE_M, 1e-4), position=(0, 0, -5e-5), **look)]
    if body.shape == "sphere":
        return [scene.add_icosphere(name, radius=outline["radius"], subdivisions=4, **look)]
    if body.shape in ("cylinder", "capsule"):
        make = trimesh.creation.cylinder if body.shape == "cylinder" else trimesh.creation.capsule
        mesh = make(radius=outline["radius"], height=outline["length"])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        return [scene.add_mesh_simple(name, mesh.vertices, mesh.faces, **look)]
    return []


def paint(solids: Sequence[Any], *, movable: bool) -> None:
    """Show whether a body can be dragged."""
    for each in solids:
        each.color = _BLUE if movable else _GREY
