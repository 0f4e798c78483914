"""The cameras of the viewers: each shows the skins as large as its canvas allows, until the viewer moves it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

FIELD_OF_VIEW = np.radians(35.0)
"""The vertical angle of view [rad]; a small one keeps lines parallel that are."""
MARGINS = (0.07, 0.07, 0.08, 0.20)
"""The shares of the canvas that stay free at its left, right, top and bottom, where the legend lies."""
_OBLIQUE = np.array([0.40, -0.85, 0.95])
"""The usual direction from the skin to the camera."""
_UP = np.array([0.0, 0.0, 1.0])
_MIN_SIZE_M = 0.01
_MOVED = 0.02
"""The distance of a camera from where the page has placed it, as a share of its distance from the skin, from which on
the viewer has moved it."""

Pose = tuple[np.ndarray, np.ndarray]
"""The position of a camera, and the point it looks at [m]."""


def direction(normals: np.ndarray) -> np.ndarray:
    """Return the direction from a skin to a camera that sees the taxels obliquely from their front."""
    mean = normals.mean(axis=0) if len(normals) else _UP
    if (size := float(np.linalg.norm(mean))) < 0.35 or mean[2] > 0.7 * size:
        return _OBLIQUE / np.linalg.norm(_OBLIQUE)
    mean = mean / size
    aside = np.cross(_UP, mean) if abs(mean[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    towards = mean + 0.45 * aside / np.linalg.norm(aside) + np.array([0.0, -0.3, 0.35 if mean[2] > -0.7 else 0.0])
    return towards / np.linalg.norm(towards)


def framed(points: np.ndarray, towards: np.ndarray, aspect: float, field: float = FIELD_OF_VIEW) -> Pose:
    """Return the nearest camera that has all points in its canvas without the margins.

    Args:
        points: points in the world [m], shape ``(n, 3)``.
        towards: the unit direction from the points to the camera.
        aspect: width of the canvas by its height.
        field: vertical angle of view [rad].
    """
    right = np.cross(_UP, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), -towards])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, depth = axes @ (points - middle).T
    tall = np.tan(field / 2)
    left, side, top, bottom = (1 - 2 * margin for margin in MARGINS)
    found = [
        _fitted(x, depth, side * tall * aspect, left * tall * aspect),
        _fitted(y, depth, top * tall, bottom * tall),
    ]
    away = max(*(each[0] for each in found), _MIN_SIZE_M)
    shift = [(high - away * first + away * second - low) / 2 for _, high, low, first, second in found]
    target = middle + shift[0] * axes[0] + shift[1] * axes[1]
    return target + away * towards, target


def _fitted(across: np.ndarray, depth: np.ndarray, first: float, second: float) -> tuple[float, ...]:
    """Return the least distance at which all points lie between two planes, and what the planes' shift follows from."""
    high, low = float((across - first * depth).max()), float((-across - second * depth).max())
    return (high + low) / (first + second), high, low, first, second


class Cameras:
    """The cameras of all viewers.

    Args:
        server: viser's server.
        seen: returns the points that a camera should show, and the direction from them to it.
    """

    def __init__(self, server: viser.ViserServer, seen: Callable[[], tuple[np.ndarray, np.ndarray]]):
        self._server, self._seen = server, seen
        self._first: list[np.ndarray] = []
        self._placed: dict[int, list[np.ndarray]] = {}
        self._canvas: dict[int, tuple[int, int]] = {}

    def place_first(self) -> None:
        """Place the camera of viewers who come, before the size of their canvas is known."""
        points, towards = self._seen()
        position, target = framed(points, towards, 1.0)
        self._first.append(position)
        camera, away = self._server.initial_camera, float(np.linalg.norm(position - target))
        camera.fov, camera.near, camera.far = float(FIELD_OF_VIEW), away / 100, away * 50
        camera.up, camera.look_at, camera.position = (0.0, 0.0, 1.0), target, position

    def admit(self, client: viser.ClientHandle) -> None:
        """Show the skin to a viewer, and again when the size of their canvas changes, unless they have looked away."""
        self.show(client)

        @client.camera.on_update
        async def _(camera: viser.CameraHandle) -> None:
            size = (camera.image_width, camera.image_height)
            if size != self._canvas.get(client.client_id) and not self._is_moved(client):
                self.show(client)

    def forget(self, client: viser.ClientHandle) -> None:
        """Drop what is known of a viewer who has left."""
        self._placed.pop(client.client_id, None)
        self._canvas.pop(client.client_id, None)

    def show_again(self) -> None:
        """Show the skin to all viewers who have not moved their camera."""
        self.place_first()
        for client in self._server.get_clients().values():
            if not self._is_moved(client):
                self.show(client)

    def show(self, client: viser.ClientHandle) -> None:
        """Show the skin to a viewer."""
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        if min(size) < 8:
            return
        points, towards = self._seen()
        position, target = framed(points, towards, size[0] / size[1])
        away = float(np.linalg.norm(position - target))
        self._canvas[client.client_id] = size
        self._placed[client.client_id] = [*self._placed.get(client.client_id, [])[-2:], position]
        with client.atomic():
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.position, camera.look_at = position, target
            camera.fov, camera.near, camera.far = float(FIELD_OF_VIEW), away / 100, away * 50

    def _is_moved(self, client: viser.ClientHandle) -> bool:
        placed = self._placed.get(client.client_id)
        if placed is None:
            return False
        camera: Any = client.camera
        away = float(np.linalg.norm(camera.position - camera.look_at))
        return min(float(np.linalg.norm(camera.position - each)) for each in [*placed, *self._first]) > _MOVED * away
