"""``.ros2.mcap``: messages of ROS 2's own packages, for ``ros2 bag play``, RViz and PlotJuggler, without ROS.

==================================  ========================================================================
``/tf``                             ``tf2_msgs/TFMessage``: bodies in the world, whenever they have moved
``/tf_static``                      the same: the frames of skins on their bodies
``/bodies``                         ``visualization_msgs/MarkerArray``: their shapes
``/SKIN/taxels``                    ``sensor_msgs/PointCloud2``: ideal, measured and counts as fields
``/SKIN/log``                       ``rcl_interfaces/Log``: events; what was dropped and injected as warnings
``/SKIN/tx``, ``/rx``, ``/drop``    ``tactemu/Frame``, as in the log, with its definition in the file
==================================  ========================================================================

Names keep letters, digits and underscores. Times are those of the log.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from tactemu.scene.description import BodyDescription, SceneDescription
from tactemu.truth.entries import BodyPose, End, Entry, Header, Passage, Sample
from tactemu.truth.messages import message_of
from tactemu.view.conversions.display import is_warning, log_text
from tactemu.view.conversions.taxel_tables import WORLD, TaxelTable, tables_of

_CHUNK_BYTES = 1 << 20
_TYPES = {"|i1": 1, "|u1": 2, "<i2": 3, "<u2": 4, "<i4": 5, "<u4": 6, "<f4": 7, "<f8": 8}
"""The numbers of types in ``sensor_msgs/PointField``."""
_CUBE, _SPHERE, _CYLINDER, _TRIANGLES = 1, 2, 3, 11
"""Types of ``visualization_msgs/Marker``."""
_INFO, _WARN = 20, 30
"""Levels of ``rcl_interfaces/Log``."""
_PLANE_M = 0.5


class Ros2File:
    """Messages of ROS 2, in an MCAP file of its own."""

    def __init__(self, target: Path):
        self._file = target.open("wb")
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="tactemu")
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._tables: dict[tuple, list[tuple[str, str, TaxelTable, list]]] = {}
        self._placed: set[str] = set()
        self._scene = SceneDescription()

    def begin(self, header: Header) -> None:
        """Write the bodies' shapes."""
        self._scene = SceneDescription.from_json(header.scene)
        bodies = self._scene.bodies
        if not bodies:
            return
        markers = [marker for k, body in enumerate(bodies) for marker in self._markers(k, body)]
        self._write("/bodies", "visualization_msgs/msg/MarkerArray", 0, self._new("MarkerArray", markers=markers))

    def add(self, entry: Entry) -> None:
        """Write the messages of an entry."""
        t_ns = max(entry.t_ns, 0)
        if isinstance(entry, Sample):
            self._sample(entry, t_ns)
        elif isinstance(entry, BodyPose):
            self._transform("/tf", t_ns, [(WORLD, entry.body, entry.position, entry.quaternion)])
        elif isinstance(entry, Passage):
            kind, message, values = message_of(entry)
            self._put(_topic(entry.device, kind), message.name, message.definition, t_ns, message.encode(values))
        if not isinstance(entry, Sample | BodyPose) and (is_warning(entry) or not isinstance(entry, Passage)):
            log = self._new(
                "Log", stamp=self._time(t_ns), level=_WARN if is_warning(entry) else _INFO, name=entry.device,
                msg=log_text(entry), file="", function="", line=0,
            )  # fmt: skip
            self._write(_topic(entry.device, "log"), "rcl_interfaces/msg/Log", t_ns, log)

    def finish(self, end: End) -> None:
        """Write the index, and close the file."""
        self._writer.finish()
        self._file.close()

    # -- messages ------------------------------------------------------------------------------------------------------

    def _sample(self, sample: Sample, t_ns: int) -> None:
        if not np.ndim(sample.ideal) or not len(sample.ideal):
            return
        key = sample.device, sample.sense, sample.ideal.shape, sample.counts.shape, sample.counts.dtype
        if key not in self._tables:
            self._tables[key] = [self._cloud(sample, table) for table in tables_of(self._scene, sample)]
        for topic, frame, table, fields in self._tables[key]:
            rows = table.rows(sample)
            cloud = self._new(
                "PointCloud2", header=self._header(t_ns, frame), height=1, width=len(rows), fields=fields,
                is_bigendian=False, point_step=table.stride, row_step=table.stride * len(rows),
                data=np.frombuffer(rows.tobytes(), np.uint8), is_dense=True,
            )  # fmt: skip
            self._write(topic, "sensor_msgs/msg/PointCloud2", t_ns, cloud)

    def _cloud(self, sample: Sample, table: TaxelTable) -> tuple[str, str, TaxelTable, list]:
        """Return topic, frame, table and fields of one part of a skin, after writing its frame once."""
        part = table.part
        fields = [
            self._new("PointField", name=name, offset=offset, datatype=_TYPES[dtype.str], count=1)
            for name, offset, dtype in table.fields
        ]
        name, frame = part.name or sample.device, f"skin/{part.name or sample.device}"
        if frame not in self._placed:
            self._placed.add(frame)
            self._transform("/tf_static", 0, [(part.body, frame, part.position, part.quaternion)])
        return _topic(*filter(None, (name, sample.sense)), "taxels"), frame, table, fields

    def _transform(self, topic: str, t_ns: int, poses: list) -> None:
        transforms = [
            self._new(
                "TransformStamped", header=self._header(t_ns, parent), child_frame_id=child,
                transform=self._new("Transform", translation=self._xyz("Vector3", position), rotation=self._turn(turn)),
            )
            for parent, child, position, turn in poses
        ]  # fmt: skip
        self._write(topic, "tf2_msgs/msg/TFMessage", t_ns, self._new("TFMessage", transforms=transforms))

    def _markers(self, number: int, body: BodyDescription) -> list:
        """Return the markers of a body in its own frame; a capsule is a cylinder and two balls."""
        outline, origin = body.outline, (0.0, 0.0, 0.0)
        if "faces" in outline:
            corners = [outline["vertices"][k] for face in outline["faces"] for k in face]
            return [self._marker(number, body, _TRIANGLES, (1, 1, 1), origin, corners)]
        if body.shape == "plane":
            return [self._marker(number, body, _CUBE, (_PLANE_M, _PLANE_M, 1e-3), (0.0, 0.0, -5e-4))]
        if body.shape == "box":
            return [self._marker(number, body, _CUBE, outline["size"], origin)]
        if "radius" not in outline:
            return []
        across, length = 2 * outline["radius"], outline.get("length", 0.0)
        ends = [(0.0, 0.0, z) for z in (-length / 2, length / 2)] if body.shape == "capsule" else []
        ends = [origin] if body.shape == "sphere" else ends
        found = [self._marker(number, body, _SPHERE, (across,) * 3, end, place=k) for k, end in enumerate(ends)]
        if body.shape != "sphere":
            found.append(self._marker(number, body, _CYLINDER, (across, across, length), origin, place=len(ends)))
        return found

    def _marker(
        self, number: int, body: BodyDescription, kind: int, size: Any, at: Any, corners: Any = (), place: int = 0
    ) -> Any:
        pose = self._new("Pose", position=self._xyz("Point", at), orientation=self._turn((1, 0, 0, 0)))
        nothing = self._new("CompressedImage", header=self._header(0, ""), format="", data=np.zeros(0, np.uint8))
        return self._new(
            "Marker", header=self._header(0, body.name), ns=body.name, id=100 * number + place, type=kind, action=0,
            pose=pose, scale=self._xyz("Vector3", size), color=self._new("ColorRGBA", r=0.6, g=0.6, b=0.65, a=0.5),
            lifetime=self._new("Duration", sec=0, nanosec=0), frame_locked=True,
            points=[self._xyz("Point", each) for each in corners], colors=[], texture_resource="", texture=nothing,
            uv_coordinates=[], text="", mesh_resource="", mesh_use_embedded_materials=False,
            mesh_file=self._new("MeshFile", filename="", data=np.zeros(0, np.uint8)),
        )  # fmt: skip

    # -- parts of messages ---------------------------------------------------------------------------------------------

    def _new(self, kind: str, /, **fields: Any) -> Any:
        return self._store.types[_PACKAGES[kind]](**fields)

    def _xyz(self, name: str, values: Any) -> Any:
        x, y, z = map(float, values)
        return self._new(name, x=x, y=y, z=z)

    def _turn(self, values: Any) -> Any:
        w, x, y, z = map(float, values)
        return self._new("Quaternion", x=x, y=y, z=z, w=w)

    def _time(self, t_ns: int) -> Any:
        return self._new("Time", sec=t_ns // 10**9, nanosec=t_ns % 10**9)

    def _header(self, t_ns: int, frame: str) -> Any:
        return self._new("Header", stamp=self._time(t_ns), frame_id=frame)

    # -- the file ------------------------------------------------------------------------------------------------------

    def _write(self, topic: str, kind: str, t_ns: int, message: Any) -> None:
        definition = "" if kind in self._schemas else self._store.generate_msgdef(kind, ros_version=2)[0]
        self._put(topic, kind, definition, t_ns, bytes(self._store.serialize_cdr(message, kind)))

    def _put(self, topic: str, kind: str, definition: str, t_ns: int, data: bytes) -> None:
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition.encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns)


_PACKAGES = {
    name: f"{package}/msg/{name}"
    for package, names in {
        "builtin_interfaces": ("Time", "Duration"),
        "geometry_msgs": ("Point", "Pose", "Quaternion", "Transform", "TransformStamped", "Vector3"),
        "rcl_interfaces": ("Log",),
        "sensor_msgs": ("CompressedImage", "PointCloud2", "PointField"),
        "std_msgs": ("ColorRGBA", "Header"),
        "tf2_msgs": ("TFMessage",),
        "visualization_msgs": ("Marker", "MarkerArray", "MeshFile"),
    }.items()
    for name in names
}


def _topic(*names: str) -> str:
    """Return a topic name that ROS accepts."""
    words = [re.sub(r"\W", "_", word, flags=re.ASCII) for name in names for word in name.split("/")]
    return "/" + "/".join(f"_{word}" if word[:1].isdigit() else word for word in words)
