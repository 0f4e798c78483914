"""The shapes by name, one line each. A shape's own file has everything else.

>>> from tactemu.geometry.shapes.registry import shape_class
>>> shape_class("sphere")(radius=0.01).reach("ball", (0, 0, 1))
0.01
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_protocols.named_classes import NamedClasses
from tactemu.base.own_code import load_class

if TYPE_CHECKING:
    from tactemu.geometry.shapes.shape import Shape

SHAPES: dict[str, str] = {
    # name in scene files: "module:Class", imported only when asked for
    "sphere": "tactemu.geometry.shapes.sphere:Sphere",
    "box": "tactemu.geometry.shapes.box:Box",
    "capsule": "tactemu.geometry.shapes.capsule:Capsule",
    "cylinder": "tactemu.geometry.shapes.cylinder:Cylinder",
    "plane": "tactemu.geometry.shapes.plane:Plane",
    "mesh": "tactemu.geometry.shapes.mesh:Mesh",
    "voxel_grid": "tactemu.geometry.shapes.voxel_grid:VoxelGrid",
}
"""The class of each shape. Scene files, the JSON schema, :mod:`tactemu`, MuJoCo's geoms and the docs derive from it."""


SYNONYMS = {
    "cube": "box", "cuboid": "box", "block": "box", "ball": "sphere", "rod": "cylinder", "disk": "cylinder",
    "pill": "capsule", "floor": "plane", "ground": "plane",
}  # fmt: skip
"""Other words for shapes; messages about an unknown shape name ours."""


REGISTRY = NamedClasses("shape", "tactemu.shapes", SHAPES, "tactemu.geometry.shapes.shape:Shape", synonyms=SYNONYMS)
"""The shapes of :data:`SHAPES`, of installed packages and of files."""


def shape_class(name: str) -> type[Shape]:
    """Return the class of a shape by its name, or of your own shape by ``path/to/file.py:Class``.

    Raises:
        SceneError: there is no such shape, or the file raises an error.
    """
    return load_class(REGISTRY, name)
