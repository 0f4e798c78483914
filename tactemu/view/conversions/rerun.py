"""Rerun: a log as ``.rrd``, or a live run, with a blueprint that lays it out.

==========================  ============================================================================
``bodies/NAME``             the pose of each body, and its shape
``bodies/NAME/SKIN``        its taxels, coloured by their measured values, an arrow for each force on the skin
``values/SKIN/ideal``       curves of every number: without imperfections, with them, and as decoded
``values/SKIN/measured``
``values/SKIN/counts``
``pictures/SKIN/PATCH``     the magnitudes of a patch of rows and columns as a picture
``wire/SKIN``               frames both ways; what was dropped and injected as warnings
==========================  ============================================================================

Entries are gathered and sent in columns. Times are those of the log, on the timeline ``time``.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from firmware_protocols.layouts import Patch
from tactemu.base.style import colours
from tactemu.scene.description import BodyDescription, PartDescription, SceneDescription
from tactemu.truth.entries import BodyPose, End, Entry, Header, Sample
from tactemu.truth.memory import size_of
from tactemu.view.conversions.display import in_contact, is_warning, log_text, pitch
from tactemu.view.conversions.taxel_tables import grids_of, parts_of

TIMELINE = "time"
_MAX_WAITING_BYTES = 1_000_000
"""Size of waiting entries above which they are sent."""
_MAX_WAIT_S = 0.1
"""Age of the oldest waiting entry above which all are sent."""
_MAX_ARROW_M = 0.01
"""Length of the arrow of the largest force so far."""
_PLANE_M = 0.5
_CURVES = ("ideal", "measured", "counts")
_MAX_CURVES = 512
"""Maximum number of values of a skin that are shown as curves by default."""


class RerunFile:
    """A Rerun recording.

    Args:
        target: the file; None: call :meth:`connect` to choose a viewer.
    """

    def __init__(self, target: Path | None):
        logging.getLogger("rerun").setLevel(logging.WARNING)
        self._stream = rr.RecordingStream("tactemu", send_properties=False)
        if target is not None:
            self._stream.save(target)
        self._scene = SceneDescription()
        self._skins: dict[tuple, _Skin] = {}
        self._poses: dict[str, list[BodyPose]] = {}
        self._words: dict[str, list[Entry]] = {}
        self._waiting, self._since = 0, 0.0
        self._laid_out: tuple = ()

    def connect(self, url: str | None) -> None:
        """Send to the viewer that listens at ``url``; None: to a local viewer, started if there is none."""
        if url is None:
            self._stream.spawn()
        else:
            self._stream.connect_grpc(url)

    def begin(self, header: Header) -> None:
        """Write the bodies' shapes."""
        self._scene = SceneDescription.from_json(header.scene)
        self._stream.log("bodies", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for body in self._scene.bodies:
            for name, shape in _shapes(body):
                self._stream.log(f"{_path('bodies', body.name)}/{name}", shape, static=True)

    def add(self, entry: Entry) -> None:
        """Keep the entry, and send all that wait if they are many."""
        if not self._waiting:
            self._since = time.monotonic()
        if isinstance(entry, Sample):
            self._sample(entry)
        elif isinstance(entry, BodyPose):
            self._poses.setdefault(entry.body, []).append(entry)
        else:
            self._words.setdefault(entry.device, []).append(entry)
        self._waiting += size_of(entry)
        if self._waiting > _MAX_WAITING_BYTES:
            self.flush()
            self._stream.flush()

    def is_due(self) -> bool:
        """Return True if the oldest waiting entry should be sent now."""
        return bool(self._waiting) and time.monotonic() - self._since > _MAX_WAIT_S

    def flush(self) -> None:
        """Send all waiting entries, in columns."""
        self._waiting = 0
        for body, poses in self._poses.items():
            self._send_poses(_path("bodies", body), poses)
        for skin in self._skins.values():
            skin.send()
        for device, found in self._words.items():
            texts, levels = map(log_text, found), ("WARN" if is_warning(each) else "INFO" for each in found)
            columns = rr.TextLog.columns(text=list(texts), level=list(levels))
            self._stream.send_columns(_path("wire", device), _times(each.t_ns for each in found), columns)
        self._poses, self._words = {}, {}
        self._lay_out()

    def finish(self, end: End) -> None:
        """Send all waiting entries, and close the file."""
        self.flush()
        self._stream.flush()
        self._stream.disconnect()

    def _sample(self, sample: Sample) -> None:
        if not np.ndim(sample.ideal) or not np.size(sample.ideal):
            return
        key = sample.device, sample.sense, sample.ideal.shape, sample.counts.shape
        if key not in self._skins:
            parts, grids = parts_of(self._scene, sample), grids_of(self._scene, sample.device)
            self._skins[key] = _Skin(self._stream, sample, parts, grids)
        self._skins[key].waiting.append(sample)

    def _send_poses(self, path: str, poses: list[BodyPose]) -> None:
        turns = np.array([each.quaternion for each in poses])[:, [1, 2, 3, 0]]
        columns = rr.Transform3D.columns(translation=np.array([each.position for each in poses]), quaternion=turns)
        self._stream.send_columns(path, _times(each.t_ns for each in poses), columns)

    def _lay_out(self) -> None:
        """Send a blueprint of all skins if there is a new one."""
        skins = tuple(skin.name for skin in self._skins.values())
        if skins == self._laid_out:
            return
        self._laid_out = skins
        curves = [
            rrb.TimeSeriesView(origin=f"values/{skin.name}", name=skin.name.replace("/", " "))
            for skin in self._skins.values()
            if skin.numbers <= _MAX_CURVES
        ]
        pictures = [view for skin in self._skins.values() for view in skin.views()]
        side: list[Any] = [rrb.Tabs(*curves, name="curves")] if curves else []
        side += [rrb.Grid(*pictures, name="pictures")] if pictures else []
        layout = rrb.Vertical(
            rrb.Horizontal(rrb.Spatial3DView(origin="bodies", name="bodies and taxels"), rrb.Vertical(*side)),
            rrb.TextLogView(origin="wire", name="wire"),
            row_shares=[3, 1],
        )
        self._stream.send_blueprint(rrb.Blueprint(layout, collapse_panels=True))


class _Skin:
    """Samples of one sense of one skin that wait to be sent."""

    def __init__(self, stream: rr.RecordingStream, first: Sample, parts: list[PartDescription], patches: list[Patch]):
        self.name = _path(*filter(None, (first.device, first.sense)))
        self.numbers = sum(np.size(getattr(first, name)) for name in _CURVES)
        self.waiting: list[Sample] = []
        self._stream, self._parts = stream, parts
        self._most = 0.0
        n = len(first.ideal)
        self._vectors = first.ideal.shape == (n, 3)
        self._pictures = [
            (f"pictures/{self.name}/{_path(patch.name)}", patch) for patch in patches if patch.start + len(patch) <= n
        ]
        for path, patch in self._pictures:
            size = rr.components.ImageFormat(width=patch.cols, height=patch.rows, channel_datatype="F32")
            stream.log(path, rr.DepthImage.from_fields(format=size, colormap="inferno"), static=True)
        for part in parts:
            path = self._place(part)
            stream.log(path, _transform(part.position, part.quaternion), static=True)
            stream.log(
                f"{path}/taxels", rr.Points3D.from_fields(positions=part.positions, radii=pitch(part) / 3), static=True
            )
            if self._vectors:
                stream.log(
                    f"{path}/forces",
                    rr.Arrows3D.from_fields(origins=part.positions, radii=pitch(part) / 12),
                    static=True,
                )
            for name, shape in _debug_shapes(part):
                stream.log(f"{path}/{name}", shape, static=True)

    def _place(self, part: PartDescription) -> str:
        return _path("bodies", *((part.body,) if part.body != "world" else ()), self.name, *part.name.split("/")[1:])

    def views(self) -> list[Any]:
        """Return a view for each picture."""
        return [rrb.Spatial2DView(origin=path, name=path.split("/", 1)[1]) for path, _ in self._pictures]

    def send(self) -> None:
        """Send the waiting samples, in columns."""
        if not self.waiting:
            return
        samples, self.waiting = self.waiting, []
        times = _times(each.t_ns for each in samples)
        for name in _CURVES:
            values = np.stack([np.asarray(getattr(each, name), float).ravel() for each in samples])
            if values.shape[1]:
                self._stream.send_columns(f"values/{self.name}/{name}", times, rr.Scalars.columns(scalars=values))
        measured = np.stack([np.asarray(each.measured, float) for each in samples])
        size = np.linalg.norm(measured, axis=2) if measured.ndim == 3 else np.abs(measured)
        self._most = max(self._most, float(np.nanmax(size, initial=0.0)))
        for part in self._parts:
            path, count = self._place(part), len(part.taxels)
            self._coloured(f"{path}/taxels", times, colours(size[:, part.taxels] / (self._most or 1.0)))
            if self._vectors:
                arrows = np.nan_to_num(measured[:, part.taxels] / (self._most or 1.0) * _MAX_ARROW_M).reshape(-1, 3)
                columns = rr.Arrows3D.columns(vectors=arrows).partition([count] * len(samples))
                self._stream.send_columns(f"{path}/forces", times, columns)
            if part.draw:
                met = np.stack([in_contact(each)[part.taxels] for each in samples])[..., None]
                painted = np.where(met, part.draw.contact_color, part.draw.probe_color)
                self._coloured(f"{path}/probes", times, painted)
                if part.draw.opacity:
                    opaque = np.full((*painted.shape[:-1], 1), part.draw.opacity)
                    self._coloured(f"{path}/radii", times, np.concatenate([painted, opaque], axis=-1), rr.Ellipsoids3D)
        for path, patch in self._pictures:
            self._send_pictures(path, samples, size, patch)

    def _coloured(self, path: str, times: Sequence, painted: np.ndarray, kind: Any = rr.Points3D) -> None:
        flat = (painted.reshape(-1, painted.shape[-1]) * 255).round().astype(np.uint8)
        columns = kind.columns(colors=flat).partition([painted.shape[1]] * len(painted))
        self._stream.send_columns(path, times, columns)

    def _send_pictures(self, path: str, samples: list[Sample], size: np.ndarray, patch: Patch) -> None:
        pictures = np.ascontiguousarray(size[:, patch.taxels], np.float32)
        columns = rr.DepthImage.columns(buffer=pictures.view(np.uint8))
        self._stream.send_columns(path, _times(each.t_ns for each in samples), columns)


def _path(*names: str) -> str:
    return "/".join(rr.escape_entity_path_part(word) for name in names for word in name.split("/") if word)


def _times(t_ns: Any) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(TIMELINE, duration=np.fromiter(t_ns, np.int64).astype("timedelta64[ns]"))]


def _transform(position: Any, quaternion: Any) -> rr.Transform3D:
    w, x, y, z = quaternion
    return rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=[x, y, z, w]))


def _shapes(body: BodyDescription) -> list[tuple[str, Any]]:
    """Return the shapes of a body, in its frame."""
    found: list[tuple[str, Any]] = []
    outline, grey = body.outline, (150, 150, 165, 110)
    solid: dict[str, Any] = {"colors": [grey], "fill_mode": "solid"}
    if "faces" in outline:
        mesh = rr.Mesh3D(vertex_positions=outline["vertices"], triangle_indices=outline["faces"], albedo_factor=grey)
        found.append(("shape", mesh))
    elif body.shape == "box":
        found.append(("shape", rr.Boxes3D(sizes=[outline["size"]], **solid)))
    elif body.shape == "plane":
        found.append(("shape", rr.Boxes3D(sizes=[(_PLANE_M, _PLANE_M, 1e-3)], centers=[(0, 0, -5e-4)], **solid)))
    elif body.shape == "sphere":
        found.append(("shape", rr.Ellipsoids3D(half_sizes=[[outline["radius"]] * 3], **solid)))
    elif body.shape == "cylinder":
        found.append(("shape", rr.Cylinders3D(lengths=[outline["length"]], radii=[outline["radius"]], **solid)))
    elif body.shape == "capsule":  # Rerun's begins at its lower end
        low = [(0, 0, -outline["length"] / 2)]
        capsule = rr.Capsules3D(lengths=[outline["length"]], radii=[outline["radius"]], translations=low, **solid)
        found.append(("shape", capsule))
    if body.points:
        colour = [round(255 * part) for part in body.points.color]
        points = rr.Points3D(body.points.positions, radii=body.points.radius, colors=[colour])
        found.append(("points", points))
    return found


def _debug_shapes(part: PartDescription) -> list[tuple[str, Any]]:
    """Return the shapes of the probes of a sensor with ``draw_debug``."""
    if part.draw is None:
        return []
    positions, radii = part.draw.probes, part.draw.radii
    found: list[tuple[str, Any]] = [
        ("probes", rr.Points3D.from_fields(positions=positions, radii=part.draw.center_radius))
    ]
    if part.draw.opacity:
        balls = rr.Ellipsoids3D.from_fields(
            centers=positions, half_sizes=np.repeat(radii[:, None], 3, axis=1), fill_mode="solid"
        )
        found.append(("radii", balls))
    return found
