"""tactemu: a simulated tactile skin on the far end of the wire.

Names are imported on first use, so that ``import tactemu`` costs nothing.
"""

from __future__ import annotations

import importlib

from tactemu.physics.models import MODELS

_PUBLIC = {
    # public name: module that defines it
    "Scene": "tactemu.scene.scene",
    "Body": "tactemu.scene.bodies",
    "Sphere": "tactemu.scene.bodies",
    "Box": "tactemu.scene.bodies",
    "Capsule": "tactemu.scene.bodies",
    "Cylinder": "tactemu.scene.bodies",
    "Plane": "tactemu.scene.bodies",
    "Mesh": "tactemu.scene.bodies",
    "VoxelGrid": "tactemu.scene.bodies",
    "MujocoSource": "tactemu.scene.mujoco_source",
    "Hold": "tactemu.scene.motion",
    "Press": "tactemu.scene.motion",
    "Slide": "tactemu.scene.motion",
    "Roll": "tactemu.scene.motion",
    "Spin": "tactemu.scene.motion",
    "Keyframes": "tactemu.scene.motion",
    "FromFunction": "tactemu.scene.motion",
    "Sequence": "tactemu.scene.motion",
    "Together": "tactemu.scene.motion",
    "Pose": "tactemu.scene.motion",
    "Event": "tactemu.scene.schema",
    "serve": "tactemu.serving",
    "TactemuError": "tactemu.errors",
    **{kind: module for module, _, kind in (target.partition(":") for target in MODELS.values())},
}

__all__ = list(_PUBLIC)


def __getattr__(name: str):
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'tactemu' has no attribute {name!r}")


def __dir__():
    return __all__
