"""The face for sensor models, shapes, transducers and engines of your own: the names that such a file imports.

>>> from tactemu.models import Compiled, SensorModel, Site, Stage, model_class
>>> issubclass(model_class("kinematic_taxel"), SensorModel)
True

Import from a face, never from the modules below it, which may change in every version (``docs/versions.md``).
``docs/adding-a-sensor-model.md`` builds a model and ``docs/adding-a-shape.md`` a shape from these names. The names that
build and run a scene (``Scene``, ``Press``, ``serve``) are in :mod:`tactemu`, those of a device in
:mod:`tactemu.devices`.
"""

from firmware_protocols.bounds import Bounds
from firmware_protocols.senses import Quantity
from tactemu.base.errors import MeshError, SceneError
from tactemu.base.options import number, numbers, triple
from tactemu.base.units import Length
from tactemu.geometry.bodies import Body
from tactemu.geometry.shapes.distance import ShapeFunctions, shape_functions
from tactemu.geometry.shapes.rays import LinePieces, line_pieces, ray_function, traced_ray
from tactemu.geometry.shapes.registry import shape_class
from tactemu.geometry.shapes.shape import FAR, Row, Shape, ShapeKind, box_outline, table_type
from tactemu.imperfections import ElectronicsOptions, ImperfectionOptions, ReadingInfo
from tactemu.imperfections.info import Channels
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import Launch, Launches, in_turn, record
from tactemu.plan.plan import Context, Dtype, Stage
from tactemu.plan.scalars import is_finite, is_nan, natural
from tactemu.scene.engine_interface import Engine, JointMotors
from tactemu.scene.engine_tables import EngineTable
from tactemu.sensors.drawing import DrawOptions
from tactemu.sensors.models import model_class
from tactemu.sensors.point_cloud import PointCloud
from tactemu.sensors.poses import LinkView
from tactemu.sensors.probe_grid import Grid
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.probes.query import CHEAPER_QUERY, nearest_function, query_trials
from tactemu.sensors.sensed import sensed_type
from tactemu.sensors.sensor_model import Compiled, DepthQuery, Derive, SensorModel, Setting, Site, TouchPoints
from tactemu.sensors.shape_table import ShapeTable, ShapeTables
from tactemu.transducers.registry import transducer_class
from tactemu.transducers.transducer import (
    CAPACITANCE,
    DEPTH,
    DISPLACEMENT,
    FIELD,
    FORCE,
    PRESSURE,
    RESISTANCE,
    SIGNAL_TYPES,
    SignalType,
    Transducer,
    TransducerSite,
)

__all__ = [  # noqa: RUF022  (in groups)
    # the contract of a sensor model: it derives from SensorModel, and compiles a Site to a Compiled
    "Channels", "Compiled", "DepthQuery", "Derive", "DrawOptions", "Dtype", "ElectronicsOptions", "Grid",
    "ImperfectionOptions", "LinkView", "PointCloud", "Probes", "Quantity", "ReadingInfo", "SensorModel", "ShapeTable",
    "ShapeTables", "Site", "Setting",
    "TouchPoints", "model_class",
    # the stages of a step, and the context that allocates their arrays and records their launches
    "Context", "Launch", "Launches", "Stage", "clear_rows", "in_turn", "record",
    # functions for kernels: the nearest surface, distances, lines through bodies, numbers that are not finite
    "CHEAPER_QUERY", "is_finite", "is_nan", "natural", "nearest_function", "query_trials", "ray_function",
    "sensed_type", "shape_functions", "ShapeFunctions",
    # checks of options, and the errors that they raise
    "Bounds", "MeshError", "SceneError", "number", "numbers", "triple",
    # bodies and shapes
    "FAR", "Body", "Length", "LinePieces", "Row", "Shape", "ShapeKind", "box_outline", "line_pieces",
    "shape_class", "table_type", "traced_ray",
    # transducers, which turn the reading of a model into another quantity
    "CAPACITANCE", "DEPTH", "DISPLACEMENT", "FIELD", "FORCE", "PRESSURE", "RESISTANCE", "SIGNAL_TYPES", "SignalType",
    "Transducer", "TransducerSite", "transducer_class",
    # engines, which move bodies of a scene: the table in the scene file, and what it opens
    "Engine", "EngineTable", "JointMotors",
]  # fmt: skip
