"""The lights of the page, and the colours that have to be sent so that a viewer sees the colours that are meant.

viser's page maps the light of a surface to the screen by the curve that three.js calls "ACES filmic", which makes
everything paler. The inverse of that curve gives the surface colour for the colour on the screen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
import viser
from trimesh.exchange.gltf import export_glb

from tactemu.view.page.shapes import Mesh

_AMBIENT, _SUN = 2.4, 0.9
"""The light that a surface reflects: from all sides, and from the sun if it faces it [fractions of its colour]."""
SUN = np.array([-0.45, -0.35, 1.0])
"""The direction to the sun."""
_USUAL = _AMBIENT + 0.75 * _SUN
"""The light on a surface that faces half up."""
_INTO = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_OUT_OF = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_EXPOSURE = 1 / 0.6


def add_lights(scene: viser.SceneApi) -> None:
    """Light the scene from all sides, and from above; without shadow maps, for which a machine without a GPU is too
    slow."""
    scene.configure_environment_map(None)
    scene.configure_default_lights(False, cast_shadow=False)
    scene.add_light_ambient("/lights/all", intensity=_AMBIENT * np.pi)
    scene.add_light_directional("/lights/sun", intensity=_SUN * np.pi, position=tuple(SUN), cast_shadow=False)


def linear(srgb: np.ndarray) -> np.ndarray:
    """Return the intensities of colours that are coded as sRGB, both from 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def coded(intensity: np.ndarray) -> np.ndarray:
    """Return the sRGB code of intensities, both from 0 to 1."""
    return np.where(intensity <= 0.0031308, 12.92 * intensity, 1.055 * np.maximum(intensity, 0) ** (1 / 2.4) - 0.055)


def surface(seen: np.ndarray) -> np.ndarray:
    """Return the intensities that a surface must reflect to be seen in a colour (sRGB, 0 to 1), as far as it can."""
    mapped = np.clip(linear(np.asarray(seen, float)), 0.0, 0.98) @ np.linalg.inv(_OUT_OF).T
    a = 1 - 0.983729 * mapped
    b = 0.0245786 - 0.4329510 * mapped
    c = -0.000090537 - 0.238081 * mapped
    root = (-b + np.sqrt(np.maximum(b**2 - 4 * a * c, 0.0))) / (2 * a)
    return np.clip(root @ np.linalg.inv(_INTO).T / _EXPOSURE / _USUAL, 0.0, 1.0)


def shown(seen: np.ndarray) -> np.ndarray:
    """Return the intensities of a surface without light on it that is to be seen in a colour (sRGB, 0 to 1)."""
    return np.clip(_USUAL * surface(seen), 0.0, 1.0)


def lit_model(mesh: Mesh, seen: tuple[float, float, float], opacity: float = 1.0) -> bytes:
    """Return a mesh as a binary glTF model whose vertices have the light in their colours.

    Without a GPU that is many times faster than light that is computed for each pixel. The light turns with the body.
    """
    corners = mesh.vertices[mesh.faces]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices, float)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    sun = np.maximum(normals @ (SUN / np.linalg.norm(SUN)), 0.0)
    light = _AMBIENT * (0.78 + 0.22 * normals[:, 2]) + _SUN * sun
    colours = np.clip(surface(np.array(seen)) * light[:, None], 0.0, 1.0)
    return unlit_model(mesh, colours, opacity)


def unlit_model(mesh: Mesh, colours: np.ndarray, opacity: float = 1.0) -> bytes:
    """Return a mesh as a binary glTF model that looks the same in all light.

    Args:
        mesh: the mesh.
        colours: the intensities of its vertices (:func:`shown`), with or without opacity, shape ``(n, 3)`` or
            ``(n, 4)``, from 0 to 1.
        opacity: opacity of the whole.
    """
    made = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_colors=(255 * colours).round().astype(np.uint8), process=False
    )
    is_clear = opacity < 1 or colours.shape[1] == 4

    def unlit(tree: dict[str, Any]) -> None:
        tree["extensionsUsed"] = ["KHR_materials_unlit"]
        look: dict[str, Any] = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, opacity]}}
        look |= {"extensions": {"KHR_materials_unlit": {}}} | ({"alphaMode": "BLEND"} if is_clear else {})
        tree["materials"] = [look]
        for part in tree["meshes"]:
            for primitive in part["primitives"]:
                primitive["material"] = 0

    return export_glb(trimesh.Scene(made), tree_postprocessor=unlit)


def mesh_colour(seen: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return the colour to be sent for a mesh that is to be seen in a colour (sRGB, 0 to 1)."""
    red, green, blue = (255 * coded(surface(np.array(seen)))).round().astype(int).tolist()
    return red, green, blue


def instance_colours(seen: np.ndarray) -> np.ndarray:
    """Return the colours to be sent for instances of a batched mesh, which viser does not take as sRGB."""
    return (255 * surface(seen)).round().astype(np.uint8)
