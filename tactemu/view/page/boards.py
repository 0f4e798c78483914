"""The taxels of a scene: discs that glow with the reading, on plates; arrows for forces; the probes of a sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from firmware_protocols.layouts import Patch
from tactemu.base.style import ARROW, colours, rgb
from tactemu.geometry import rotation
from tactemu.scene.description import PartDescription
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import in_contact, pitch
from tactemu.view.page.feed import magnitudes
from tactemu.view.page.lights import instance_colours, lit_model
from tactemu.view.page.ranges import Range, Ranges
from tactemu.view.page.shapes import Mesh, carrier, faceted, joined

_PLATE = (0.20, 0.22, 0.27)
_MAX_ARROWS = 400
"""Maximum number of arrows on a body: the largest forces are drawn."""
_MIN_ARROW = 0.15
"""The smallest force that has an arrow, as a share of the range: its head is as long."""
_DISC_SIDES = 12
"""Number of sides of a taxel's disc."""
_MIN_HEXAGON_TAXELS = 1000
"""Number of taxels from which on they are drawn as hexagons: a machine without a GPU draws each triangle."""


class Board:
    """All taxels on one body: a batched mesh of discs, the plates below, arrows, and what sensors with ``draw_debug``
    show.

    Args:
        scene: viser's scene.
        path: the path of the body in it.
        parts: the parts of skins on the body, each with the name of its skin.
        patches: the patches of each skin.
        arrow_m: the length of the arrow of the largest force of the range [m].
        taxels: number of taxels in the whole scene.
    """

    def __init__(
        self, scene: viser.SceneApi, path: str, parts: Sequence[tuple[str, PartDescription]],
        patches: Mapping[str, Sequence[Patch]], *, arrow_m: float, taxels: int,
    ):  # fmt: skip
        self._parts = list(parts)
        self._arrow_m = arrow_m
        self._pitches = np.concatenate([np.full(len(part.taxels), pitch(part)) for _, part in parts])
        placed = [_placed(part) for _, part in parts]
        self.positions = np.concatenate([each[0] for each in placed])
        self.normals = np.concatenate([each[1] for each in placed])
        self.owners = [(skin, int(taxel)) for skin, part in parts for taxel in part.taxels]
        self._shares = np.zeros(len(self.owners))
        self._colours = instance_colours(colours(self._shares))
        disc = _disc() if taxels < _MIN_HEXAGON_TAXELS else _hexagon()
        self.discs = scene.add_batched_meshes_simple(
            f"{path}/taxels", disc.vertices, disc.faces, _turned(self.normals), self.positions,
            batched_scales=self._pitches.astype(np.float32), batched_colors=self._colours, lod="off",
            cast_shadow=False, receive_shadow=False, flat_shading=True,
        )  # fmt: skip
        plates = lit_model(faceted(joined(self._plates(patches, placed))), _PLATE)
        scene.add_glb(f"{path}/plates", plates, cast_shadow=False, receive_shadow=False)
        self._arrows = scene.add_arrows(
            f"{path}/forces", np.zeros((1, 2, 3), np.float32), instance_colours(rgb(ARROW)),
            shaft_radius=0.028 * arrow_m, head_radius=0.07 * arrow_m, head_length=_MIN_ARROW * arrow_m, visible=False,
        )  # fmt: skip
        self._probes = [
            _Probes(scene, f"{path}/{part.name.replace('/', '∕')}", skin, part) for skin, part in parts if part.draw
        ]

    def _plates(self, patches: Mapping[str, Sequence[Patch]], placed: Sequence[tuple[np.ndarray, ...]]) -> list[Mesh]:
        meshes = []
        for (skin, part), (positions, normals) in zip(self._parts, placed):
            for patch in patches.get(skin, ()):
                here = (part.taxels >= patch.start) & (part.taxels < patch.start + len(patch))
                if here.any():
                    size = patch.pitch if here.sum() > 1 else pitch(part)
                    meshes.append(carrier(positions[here] + 0.08 * size * normals[here], normals[here], size))
        return meshes

    def draw(self, samples: dict[str, Sample], ranges: Ranges) -> None:
        """Colour the taxels by their measured values, as shares of the range of their skin's quantity."""
        shares, vectors = [], []
        for skin, part in self._parts:
            sample, n = samples.get(skin), len(part.taxels)
            if sample is None or len(sample.measured) <= part.taxels.max(initial=-1):
                shares.append(np.zeros(n))
                vectors.append(np.zeros((n, 3)))
                continue
            scale = ranges.of(skin, sample.sense)
            shares.append(scale.shares(magnitudes(sample.measured)[part.taxels]))
            vectors.append(_vectors(sample, part, scale))
        now = instance_colours(colours(np.concatenate(shares)))
        if (now != self._colours).any():
            self._colours = self.discs.batched_colors = now
        self._draw_arrows(np.concatenate(vectors))
        for probes in self._probes:
            probes.draw(samples)

    def _draw_arrows(self, vectors: np.ndarray) -> None:
        """Draw the forces as arrows that end at the taxels, because they press from outside."""
        length = np.linalg.norm(vectors, axis=1)
        pressed = np.flatnonzero(length > _MIN_ARROW)
        if len(pressed) > _MAX_ARROWS:
            pressed = np.argpartition(-length, _MAX_ARROWS)[:_MAX_ARROWS]
        if len(pressed):
            ends = self.positions[pressed] + 0.1 * self._pitches[pressed, None] * self.normals[pressed]
            points = np.stack([ends - self._arrow_m * vectors[pressed], ends], axis=1).astype(np.float32)
            if not np.array_equal(points, self._arrows.points):
                self._arrows.points = points
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
        return instance_colours(np.where(self._was_in_contact[:, None], self._contact_colour, self._probe_colour))

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


def _disc() -> trimesh.Trimesh:
    """Return a disc on a plate; its underside lies in the plate and is not drawn."""
    disc = trimesh.creation.cylinder(radius=0.40, height=0.32, sections=_DISC_SIDES)
    seen = disc.face_normals[:, 2] > -0.5
    return trimesh.Trimesh(disc.vertices, disc.faces[seen], process=False)


def _hexagon() -> trimesh.Trimesh:
    """Return a flat hexagon that is visible from outside only."""
    turns = np.arange(6) * np.pi / 3
    corners = np.stack([0.45 * np.cos(turns), 0.45 * np.sin(turns), np.full(6, 0.12)], axis=1)
    return trimesh.Trimesh(corners, [(0, k, k + 1) for k in range(1, 5)], process=False)


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


def _vectors(sample: Sample, part: PartDescription, scale: Range) -> np.ndarray:
    """Return the forces on the taxels in the frame of the body, as shares of the range; zeros if readings are no
    vectors."""
    if np.shape(sample.measured)[1:] != (3,):
        return np.zeros((len(part.taxels), 3))
    values = np.nan_to_num(scale.shares(np.asarray(sample.measured, float)[part.taxels]))
    return rotation.rotate(rotation.normalised(part.quaternion), values)
