"""Plays reference cases of ElastomerTaxel and ProximityTaxel: same poses in, readings out.

``tests/data/soft_skin`` holds readings of genesis-world 1.4.5, run in float64 on a CPU, with the poses, point clouds
and distance grids that they follow from. Bodies are in the frame of their geometry.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

import tactemu as tt

DATA = Path(__file__).parents[1] / "data" / "soft_skin"


class Case:
    """One recorded scene."""

    def __init__(self, name: str):
        path = next(DATA.glob(f"{name}*.json"))
        self.meta = json.loads(path.read_text())
        with np.load(path.with_suffix(".npz")) as data:
            self.data = dict(data)
        self.n_steps = self.meta["n_steps"]

    def pose(self, body: int, step: int) -> dict[str, np.ndarray]:
        """Arguments of ``set_pose``, ``(n_envs, 3 or 4)`` each."""
        pose = {}
        names = {"linear_velocity": "velocity", "angular_velocity": "spin", "position": "position"}
        for argument, key in {**names, "quaternion": "quaternion"}.items():
            series = self.data.get(f"{key}{body}")
            if series is not None:
                pose[argument] = series[min(step, len(series) - 1)]
        return pose

    def shape(self, index: int):
        body = self.meta["bodies"][index]
        if body.get("grid"):
            d = self.data
            return tt.VoxelGrid(values=d[f"grid{index}"], origin=d[f"grid_origin{index}"], cell=d[f"grid_cell{index}"])
        return tt.Sphere(radius=body["size"][0]) if body["kind"] == "sphere" else tt.Box(size=body["size"])

    def options(self, sensor: dict) -> dict[str, Any]:
        """The options recorded of a sensor, in Genesis's words."""
        key = sensor["key"]
        options = dict(sensor["options"])
        options.pop("use_visual_mesh", None)  # a body has one surface here
        for name in ("probe_local_pos", "probe_local_normal", "probe_gain"):
            if f"{key}__{name}" in self.data:
                options[name] = self.data[f"{key}__{name}"]
        if sensor["clouds"]:
            options["points"] = [self.data[cloud] for cloud in sensor["clouds"]]
        return options

    def build(self, dtype: str, device: str = "cpu", convention="genesis", **changes):
        scene: Any = tt.Scene(dt=self.meta["dt"], convention=convention, names="genesis")
        for index in range(len(self.meta["bodies"])):
            scene.add_body(self.shape(index), name=f"body{index}")
        handles = {
            s["key"]: scene.add_sensor(getattr(tt, s["type"]), entity_idx=0, **self.options(s) | changes)
            for s in self.meta["sensors"]
        }
        sim = scene.build(n_envs=self.meta["n_envs"] or None, device=device, dtype=dtype)
        return sim, handles

    def play(self, dtype: str, device: str = "cpu", **changes) -> dict[str, np.ndarray]:
        """Readings of all steps by the names in the data: ``key__out``, ``key__force_gt`` ..."""
        sim, handles = self.build(dtype, device, **changes)
        resets = {event["step"] for event in self.meta["events"]}
        readings: dict[str, list] = {}
        for step in range(self.n_steps):
            if step in resets:
                sim.reset(envs=[1])
            for body in range(len(self.meta["bodies"])):
                pose = self.pose(body, step)
                sim.set_pose(body, **(pose if sim.batched else {name: value[0] for name, value in pose.items()}))
            sim.step()
            for key, sensor in handles.items():
                for suffix, reading in (("", sensor.read()), ("_gt", sensor.read_ground_truth())):
                    parts = (
                        {"force": reading[0], "torque": reading[1]} if isinstance(reading, tuple) else {"out": reading}
                    )
                    for part, values in parts.items():
                        readings.setdefault(f"{key}__{part}{suffix}", []).append(values)
        return {name: np.array(values) for name, values in readings.items()}

    def reference(self, name: str) -> np.ndarray:
        """A recorded reading; a ground truth that equals the measured reading is not stored twice."""
        return self.data[name] if name in self.data else self.data[name.removesuffix("_gt")]
