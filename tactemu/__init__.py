"""tactemu: a simulated tactile skin on the far end of the wire.

Names are imported on first use, so that ``import tactemu`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from tactemu.physics.models import MODELS
from tactemu.physics.shapes.registry import SHAPES
from tactemu.version import __version__ as __version__

if TYPE_CHECKING:  # what an editor sees; the table below says the same to Python
    from tactemu.control.client import Connection as Connection
    from tactemu.control.client import connect as connect
    from tactemu.datasets.reading import read_dataset as read_dataset
    from tactemu.errors import DeviceError as DeviceError
    from tactemu.errors import MeshError as MeshError
    from tactemu.errors import PoseError as PoseError
    from tactemu.errors import SceneError as SceneError
    from tactemu.errors import StateError as StateError
    from tactemu.errors import TactemuError as TactemuError
    from tactemu.errors import TransportError as TransportError
    from tactemu.errors import TransportUnavailable as TransportUnavailable
    from tactemu.exec.environment import ExecEnvironment as ExecEnvironment
    from tactemu.exec.environment import exec_environment as exec_environment
    from tactemu.physics.elastomer.elastomer_taxel import ElastomerTaxel as ElastomerTaxel
    from tactemu.physics.layer.elastic_layer_taxel import ElasticLayerTaxel as ElasticLayerTaxel
    from tactemu.physics.points.proximity_taxel import ProximityTaxel as ProximityTaxel
    from tactemu.physics.probes.contact_depth_probe import ContactDepthProbe as ContactDepthProbe
    from tactemu.physics.probes.contact_probe import ContactProbe as ContactProbe
    from tactemu.physics.probes.kinematic_taxel import KinematicTaxel as KinematicTaxel
    from tactemu.physics.sensor import Sensor as Sensor
    from tactemu.physics.shapes.box import Box as Box
    from tactemu.physics.shapes.capsule import Capsule as Capsule
    from tactemu.physics.shapes.cylinder import Cylinder as Cylinder
    from tactemu.physics.shapes.mesh import Mesh as Mesh
    from tactemu.physics.shapes.plane import Plane as Plane
    from tactemu.physics.shapes.sphere import Sphere as Sphere
    from tactemu.physics.shapes.voxel_grid import VoxelGrid as VoxelGrid
    from tactemu.physics.simulation import Simulation as Simulation
    from tactemu.scene.bodies import Body as Body
    from tactemu.scene.motion import FromFunction as FromFunction
    from tactemu.scene.motion import Hold as Hold
    from tactemu.scene.motion import Keyframes as Keyframes
    from tactemu.scene.motion import Pose as Pose
    from tactemu.scene.motion import Press as Press
    from tactemu.scene.motion import Roll as Roll
    from tactemu.scene.motion import Sequence as Sequence
    from tactemu.scene.motion import Slide as Slide
    from tactemu.scene.motion import Spin as Spin
    from tactemu.scene.motion import Together as Together
    from tactemu.scene.mujoco_source import MujocoSource as MujocoSource
    from tactemu.scene.mujoco_warp_engine import MujocoWarpEngine as MujocoWarpEngine
    from tactemu.scene.newton_engine import NewtonEngine as NewtonEngine
    from tactemu.scene.newton_source import NewtonSource as NewtonSource
    from tactemu.scene.scene import Scene as Scene
    from tactemu.scene.schema import Event as Event
    from tactemu.serving import Served as Served
    from tactemu.serving import serve as serve
    from tactemu.truth import Log as Log
    from tactemu.truth import Truth as Truth
    from tactemu.truth import read_log as read_log


_PUBLIC = {
    # public name: module that defines it
    "Scene": "tactemu.scene.scene",
    "read_dataset": "tactemu.datasets.reading",
    "Body": "tactemu.scene.bodies",
    "MujocoSource": "tactemu.scene.mujoco_source",
    "MujocoWarpEngine": "tactemu.scene.mujoco_warp_engine",
    "NewtonEngine": "tactemu.scene.newton_engine",
    "NewtonSource": "tactemu.scene.newton_source",
    "Simulation": "tactemu.physics.simulation",
    "Sensor": "tactemu.physics.sensor",
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
    "exec_environment": "tactemu.exec.environment",
    "ExecEnvironment": "tactemu.exec.environment",
    "Served": "tactemu.serving",
    "connect": "tactemu.control.client",
    "Connection": "tactemu.control.client",
    "Truth": "tactemu.truth",
    "Log": "tactemu.truth",
    "read_log": "tactemu.truth",
    "TactemuError": "tactemu.errors",
    "SceneError": "tactemu.errors",
    "StateError": "tactemu.errors",
    "MeshError": "tactemu.errors",
    "PoseError": "tactemu.errors",
    "DeviceError": "tactemu.errors",
    "TransportError": "tactemu.errors",
    "TransportUnavailable": "tactemu.errors",
    **{kind: module for module, _, kind in (target.partition(":") for target in (*SHAPES.values(), *MODELS.values()))},
}

__all__ = list(_PUBLIC)  # pyright: ignore[reportUnsupportedDunderAll]


if not TYPE_CHECKING:  # a checker takes a module with __getattr__ to have every name there is

    def __getattr__(name: str):
        if name in _PUBLIC:
            return getattr(importlib.import_module(_PUBLIC[name]), name)
        raise AttributeError(f"module 'tactemu' has no attribute {name!r}")


def __dir__():
    return [*__all__, "__version__"]
