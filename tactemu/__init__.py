"""tactemu: a simulated tactile skin on the far end of the wire.

Names are imported on first use, so that ``import tactemu`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from tactemu.geometry.shapes.registry import SHAPES
from tactemu.sensors.models import MODELS
from tactemu.version import __version__ as __version__

if TYPE_CHECKING:  # what an editor sees; the table below says the same to Python
    from tactemu.base.errors import DeviceError as DeviceError
    from tactemu.base.errors import MeshError as MeshError
    from tactemu.base.errors import PoseError as PoseError
    from tactemu.base.errors import SceneError as SceneError
    from tactemu.base.errors import StateError as StateError
    from tactemu.base.errors import TactemuError as TactemuError
    from tactemu.base.errors import TransportError as TransportError
    from tactemu.base.errors import TransportUnavailable as TransportUnavailable
    from tactemu.control.client import Connection as Connection
    from tactemu.control.client import connect as connect
    from tactemu.datasets.reading import read_dataset as read_dataset
    from tactemu.engines.mujoco_source import MujocoSource as MujocoSource
    from tactemu.engines.mujoco_warp_engine import MujocoWarpEngine as MujocoWarpEngine
    from tactemu.engines.newton_engine import NewtonEngine as NewtonEngine
    from tactemu.engines.newton_source import NewtonSource as NewtonSource
    from tactemu.exec.environment import ExecEnvironment as ExecEnvironment
    from tactemu.exec.environment import exec_environment as exec_environment
    from tactemu.geometry.bodies import Body as Body
    from tactemu.geometry.motion import FromFunction as FromFunction
    from tactemu.geometry.motion import Hold as Hold
    from tactemu.geometry.motion import Keyframes as Keyframes
    from tactemu.geometry.motion import Pose as Pose
    from tactemu.geometry.motion import Press as Press
    from tactemu.geometry.motion import Roll as Roll
    from tactemu.geometry.motion import Sequence as Sequence
    from tactemu.geometry.motion import Slide as Slide
    from tactemu.geometry.motion import Spin as Spin
    from tactemu.geometry.motion import Together as Together
    from tactemu.geometry.shapes.box import Box as Box
    from tactemu.geometry.shapes.capsule import Capsule as Capsule
    from tactemu.geometry.shapes.cylinder import Cylinder as Cylinder
    from tactemu.geometry.shapes.mesh import Mesh as Mesh
    from tactemu.geometry.shapes.plane import Plane as Plane
    from tactemu.geometry.shapes.sphere import Sphere as Sphere
    from tactemu.geometry.shapes.voxel_grid import VoxelGrid as VoxelGrid
    from tactemu.scene.scene import Scene as Scene
    from tactemu.scene.schema import Event as Event
    from tactemu.sensors.elastomer.elastomer_taxel import ElastomerTaxel as ElastomerTaxel
    from tactemu.sensors.layer.elastic_layer_taxel import ElasticLayerTaxel as ElasticLayerTaxel
    from tactemu.sensors.points.proximity_taxel import ProximityTaxel as ProximityTaxel
    from tactemu.sensors.probes.contact_depth_probe import ContactDepthProbe as ContactDepthProbe
    from tactemu.sensors.probes.contact_probe import ContactProbe as ContactProbe
    from tactemu.sensors.probes.kinematic_taxel import KinematicTaxel as KinematicTaxel
    from tactemu.sensors.sensor import Sensor as Sensor
    from tactemu.sensors.simulation import Simulation as Simulation
    from tactemu.session.serving import Served as Served
    from tactemu.session.serving import serve as serve
    from tactemu.truth import Log as Log
    from tactemu.truth import Truth as Truth
    from tactemu.truth import read_log as read_log


_PUBLIC = {
    # public name: module that defines it
    "Scene": "tactemu.scene.scene",
    "read_dataset": "tactemu.datasets.reading",
    "Body": "tactemu.geometry.bodies",
    "MujocoSource": "tactemu.engines.mujoco_source",
    "MujocoWarpEngine": "tactemu.engines.mujoco_warp_engine",
    "NewtonEngine": "tactemu.engines.newton_engine",
    "NewtonSource": "tactemu.engines.newton_source",
    "Simulation": "tactemu.sensors.simulation",
    "Sensor": "tactemu.sensors.sensor",
    "Hold": "tactemu.geometry.motion",
    "Press": "tactemu.geometry.motion",
    "Slide": "tactemu.geometry.motion",
    "Roll": "tactemu.geometry.motion",
    "Spin": "tactemu.geometry.motion",
    "Keyframes": "tactemu.geometry.motion",
    "FromFunction": "tactemu.geometry.motion",
    "Sequence": "tactemu.geometry.motion",
    "Together": "tactemu.geometry.motion",
    "Pose": "tactemu.geometry.motion",
    "Event": "tactemu.scene.schema",
    "serve": "tactemu.session.serving",
    "exec_environment": "tactemu.exec.environment",
    "ExecEnvironment": "tactemu.exec.environment",
    "Served": "tactemu.session.serving",
    "connect": "tactemu.control.client",
    "Connection": "tactemu.control.client",
    "Truth": "tactemu.truth",
    "Log": "tactemu.truth",
    "read_log": "tactemu.truth",
    "TactemuError": "tactemu.base.errors",
    "SceneError": "tactemu.base.errors",
    "StateError": "tactemu.base.errors",
    "MeshError": "tactemu.base.errors",
    "PoseError": "tactemu.base.errors",
    "DeviceError": "tactemu.base.errors",
    "TransportError": "tactemu.base.errors",
    "TransportUnavailable": "tactemu.base.errors",
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
