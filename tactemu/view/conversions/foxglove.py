"""``.foxglove.mcap``: Foxglove's own schemas, for its 3D panel, plots and log.

==================================  ========================================================================
``/tf``                             ``FrameTransforms``: bodies in the world, whenever they have moved
``/bodies``                         ``SceneUpdate``: their shapes, each in its own frame
``/SKIN/taxels``                    ``PointCloud``: where the taxels are; ideal, measured and counts as fields
``/SKIN/grid/PATCH``                ``Grid``: the same of a patch of rows and columns, as a picture
``/SKIN/log``                       ``Log``: frames both ways and events; what was dropped and injected as warnings
==================================  ========================================================================

A skin on several bodies has ``/SKIN/PART/taxels`` for each; a named sense stands behind the skin's name. Times are
those of the log.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import channels, messages
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from firmware_protocols.layouts import Patch
from tactemu.geometry import rotation
from tactemu.scene.description import BodyDescription, PartDescription, SceneDescription
from tactemu.truth.entries import BodyPose, End, Entry, Header, Sample
from tactemu.view.conversions.display import is_warning, log_text
from tactemu.view.conversions.taxel_tables import WORLD, TaxelTable, grids_of, tables_of

_NUMERIC = messages.PackedElementFieldNumericType
_TYPES = {
    "|u1": _NUMERIC.Uint8, "|i1": _NUMERIC.Int8, "<u2": _NUMERIC.Uint16, "<i2": _NUMERIC.Int16,
    "<u4": _NUMERIC.Uint32, "<i4": _NUMERIC.Int32, "<f4": _NUMERIC.Float32, "<f8": _NUMERIC.Float64,
}  # fmt: skip
_GREY = messages.Color(r=0.6, g=0.6, b=0.65, a=0.5)
_PLANE_M = 0.5
"""The side of the square that is drawn of an endless plane."""


class FoxgloveFile:
    """Messages of Foxglove's schemas, in an MCAP file of its own."""

    def __init__(self, target: Path):
        self._context = foxglove.Context()
        options = MCAPWriteOptions(compression=MCAPCompression.Lz4)
        self._file = foxglove.open_mcap(target, context=self._context, writer_options=options)
        self._channels: dict[str, Any] = {}
        self._clouds: dict[tuple, list[_Cloud]] = {}
        self._scene = SceneDescription()

    def begin(self, header: Header) -> None:
        """Write the bodies' shapes."""
        self._scene = SceneDescription.from_json(header.scene)
        entities = [_entity(body) for body in self._scene.bodies]
        if entities:
            update = messages.SceneUpdate(entities=entities)
            self._channel(channels.SceneUpdateChannel, "/bodies").log(update, log_time=0)

    def add(self, entry: Entry) -> None:
        """Write the messages of an entry."""
        if isinstance(entry, Sample):
            self._sample(entry)
        elif isinstance(entry, BodyPose):
            self._pose(max(entry.t_ns, 0), entry.body, entry.position, entry.quaternion)
        else:
            level = messages.LogLevel.Warning if is_warning(entry) else messages.LogLevel.Info
            message = messages.Log(
                timestamp=_stamp(entry.t_ns), level=level, message=log_text(entry), name=entry.device
            )
            self._channel(channels.LogChannel, f"/{entry.device}/log").log(message, log_time=max(entry.t_ns, 0))

    def finish(self, end: End) -> None:
        """Close the file."""
        self._file.close()

    def _channel(self, kind: Any, topic: str) -> Any:
        if topic not in self._channels:
            self._channels[topic] = kind(topic, context=self._context)
        return self._channels[topic]

    def _pose(self, t_ns: int, body: str, position: Any, quaternion: Any) -> None:
        transform = messages.FrameTransform(
            timestamp=_stamp(t_ns), parent_frame_id=WORLD, child_frame_id=body,
            translation=_vector(position), rotation=_quaternion(quaternion),
        )  # fmt: skip
        transforms = messages.FrameTransforms(transforms=[transform])
        self._channel(channels.FrameTransformsChannel, "/tf").log(transforms, log_time=t_ns)

    def _sample(self, sample: Sample) -> None:
        if not np.ndim(sample.ideal) or not len(sample.ideal):
            return
        key = sample.device, sample.sense, sample.ideal.shape, sample.counts.shape, sample.counts.dtype
        if key not in self._clouds:
            grids = grids_of(self._scene, sample.device)
            self._clouds[key] = [
                _Cloud(sample, table, grids, self._channel) for table in tables_of(self._scene, sample)
            ]
        for cloud in self._clouds[key]:
            cloud.log(sample)


class _Cloud:
    """Taxels of one part of a skin as a cloud, and as pictures of its patches."""

    def __init__(self, sample: Sample, table: TaxelTable, patches: list[Patch], channel: Any):
        self._table, part = table, table.part
        topic = "/" + "/".join(filter(None, (part.name or sample.device, sample.sense)))
        self._cloud = channel(channels.PointCloudChannel, f"{topic}/taxels")
        self._fields = [
            messages.PackedElementField(name=name, offset=offset, type=_TYPES[dtype.str])
            for name, offset, dtype in table.fields
        ]
        self._pose = messages.Pose(position=_vector(part.position), orientation=_quaternion(part.quaternion))
        places = {taxel: k for k, taxel in enumerate(part.taxels.tolist())}
        self._grids = []
        for patch in patches:
            taxels = range(patch.start, patch.start + len(patch))
            if all(taxel in places for taxel in taxels):
                own = np.array([places[taxel] for taxel in taxels])
                grid = channel(channels.GridChannel, f"{topic}/grid/{patch.name.replace(' ', '_')}")
                self._grids.append((grid, own, patch.cols, *_plane(part, own, patch)))

    def log(self, sample: Sample) -> None:
        """Write a message for the cloud and for each picture."""
        table, rows = self._table, self._table.rows(sample)
        stamp, t_ns = _stamp(sample.t_ns), max(sample.t_ns, 0)
        common = {"timestamp": stamp, "frame_id": table.part.body, "fields": self._fields}
        cloud = messages.PointCloud(pose=self._pose, point_stride=table.stride, data=rows.tobytes(), **common)
        self._cloud.log(cloud, log_time=t_ns)
        for channel, own, cols, pose, cell in self._grids:
            grid = messages.Grid(
                pose=pose, column_count=cols, cell_size=cell, row_stride=cols * table.stride,
                cell_stride=table.stride, data=rows[own].tobytes(), **common,
            )  # fmt: skip
            channel.log(grid, log_time=t_ns)


def _plane(part: PartDescription, own: np.ndarray, patch: Patch) -> tuple[messages.Pose, messages.Vector2]:
    """Return the pose of a patch's corner on its body (x along its rows, y from row to row), and the size of a cell."""
    rows, cols = patch.rows, patch.cols
    points = rotation.rotate(part.quaternion, part.positions[own].reshape(rows, cols, 3)) + part.position
    u = (points[:, -1] - points[:, 0]).mean(0) / (cols - 1)
    v = (points[-1] - points[0]).mean(0) / (rows - 1)
    x = u / np.linalg.norm(u)
    y = v - (v @ x) * x
    y = y / np.linalg.norm(y)
    corner = points[0, 0] - u / 2 - v / 2
    from trimesh.transformations import quaternion_from_matrix

    frame = np.eye(4)
    frame[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    turn = quaternion_from_matrix(frame)
    size = messages.Vector2(x=float(np.linalg.norm(u)), y=float(np.linalg.norm(v)))
    return messages.Pose(position=_vector(corner), orientation=_quaternion(turn)), size


def _entity(body: BodyDescription) -> messages.SceneEntity:
    """Return a body's shape in its own frame."""
    return messages.SceneEntity(frame_id=body.name, id=body.name, frame_locked=True, **_primitives(body))


def _primitives(body: BodyDescription) -> Mapping[str, Any]:
    outline = body.outline
    still = messages.Pose(position=_vector((0, 0, 0)), orientation=_quaternion((1, 0, 0, 0)))
    if "faces" in outline:
        points = [messages.Point3(x=x, y=y, z=z) for x, y, z in outline["vertices"]]
        corners = [corner for face in outline["faces"] for corner in face]
        return {"triangles": [messages.TriangleListPrimitive(pose=still, points=points, color=_GREY, indices=corners)]}
    if body.shape == "box":
        return {"cubes": [messages.CubePrimitive(pose=still, size=_vector(outline["size"]), color=_GREY)]}
    if body.shape == "plane":
        thin = messages.Pose(position=_vector((0, 0, -5e-4)), orientation=_quaternion((1, 0, 0, 0)))
        size = _vector((_PLANE_M, _PLANE_M, 1e-3))
        return {"cubes": [messages.CubePrimitive(pose=thin, size=size, color=_GREY)]}
    if "radius" not in outline:
        return {}
    across = 2 * outline["radius"]
    ball = _vector((across, across, across))
    if body.shape == "sphere":
        return {"spheres": [messages.SpherePrimitive(pose=still, size=ball, color=_GREY)]}
    size = _vector((across, across, outline["length"]))
    found: dict[str, list] = {
        "cylinders": [messages.CylinderPrimitive(pose=still, size=size, bottom_scale=1, top_scale=1, color=_GREY)]
    }
    if body.shape == "capsule":
        half = outline["length"] / 2
        ends = [
            messages.Pose(position=_vector((0, 0, z)), orientation=_quaternion((1, 0, 0, 0))) for z in (-half, half)
        ]
        found["spheres"] = [messages.SpherePrimitive(pose=end, size=ball, color=_GREY) for end in ends]
    return found


def _stamp(t_ns: int) -> messages.Timestamp:
    return messages.Timestamp(sec=max(t_ns, 0) // 10**9, nsec=max(t_ns, 0) % 10**9)


def _vector(values: Any) -> messages.Vector3:
    x, y, z = map(float, values)
    return messages.Vector3(x=x, y=y, z=z)


def _quaternion(values: Any) -> messages.Quaternion:
    w, x, y, z = map(float, values)
    return messages.Quaternion(x=x, y=y, z=z, w=w)
