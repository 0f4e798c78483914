"""Replays a recorded case of Genesis through our sensors."""

import json
from pathlib import Path
from typing import Any

import numpy as np

import tactemu as tt

DATA = Path(__file__).parents[1] / "data" / "genesis"
NOT_OURS = {"ent"}


class Case:
    """One file: poses per step, options and readings."""

    def __init__(self, name: str):
        self.arrays = np.load(DATA / f"{name}.npz")
        self.meta = json.loads(str(self.arrays["meta"]))
        self.n_steps, self.n_envs = self.arrays["link_pos"].shape[:2]
        self.batched = self.meta["n_envs"] > 0

    def grid(self, geom: int, gradients: bool = True) -> tt.VoxelGrid:
        """Genesis's distance grid of a geom."""
        to_index = self.arrays[f"g{geom}_sdf_T"]
        cell = 1.0 / np.diag(to_index)[:3]
        grads = self.arrays[f"g{geom}_sdf_grad"] if gradients else None
        return tt.VoxelGrid(
            values=self.arrays[f"g{geom}_sdf_val"], origin=-to_index[:3, 3] * cell, cell=cell, gradients=grads
        )

    def options(self, key: str) -> dict:
        given = self.meta["sensors"][key]["options"]
        return {k: v for k, v in given.items() if k not in NOT_OURS}

    def replay(self, shape, keys, dtype: str, device: str = "cpu", gated: bool = False, convention="genesis", **extra):
        """Readings of the sensors ``keys`` when ``shape`` is pressed into the pad: ``{key: {branch: (T, ...)}}``.

        ``gated``: the object is taken away on steps on which Genesis's contact list is empty.
        """
        scene: Any = tt.Scene(dt=self.meta["dt"], convention=convention, names="genesis")
        pad, indenter = scene.add_body(name="pad"), scene.add_body(shape, name="indenter")
        sensors = {}
        for key in keys:
            model = getattr(tt, self.meta["sensors"][key]["type"])
            sensors[key] = scene.add_sensor(model, entity_idx=pad.index, name=key, **self.options(key) | extra)
        sim = scene.build(n_envs=self.n_envs if self.batched else None, dtype=dtype, device=device)
        readings = {key: {"": [], "_gt": []} for key in keys}
        resets = {event["step"]: [1] if "envs_idx" in event["event"] else None for event in self.meta["events"]}
        for t in range(self.n_steps):
            if t in resets:
                sim.reset(resets[t])
            self._pose(sim, pad, t, self.arrays["link_pos"][t, :, 0], self.arrays["link_quat"][t, :, 0], link=0)
            away = (self.arrays["n_contacts"][t] == 0)[:, None] * [0.0, 0.0, 10.0] if gated else 0.0
            self._pose(
                sim, indenter, t, self.arrays["geom_pos"][t, :, 1] + away, self.arrays["geom_quat"][t, :, 1], link=1
            )
            sim.step()
            for key, sensor in sensors.items():
                readings[key][""].append(sensor.read())
                readings[key]["_gt"].append(sensor.read_ground_truth())
        return readings

    def _pose(self, sim, body, t, position, quaternion, link):
        a = self.arrays
        spin = a["link_cd_ang"][t, :, link]
        velocity = a["link_cd_vel"][t, :, link] + np.cross(spin, position - a["link_root_COM"][t, :, link])
        sim.set_pose(body, position=position, quaternion=quaternion, linear_velocity=velocity, angular_velocity=spin)

    def parts(self, key: str, readings, branch: str):
        """Pairs (ours, Genesis's) of every part of a reading, each ``(T, ...)``."""
        ours = readings[key][branch]
        if isinstance(ours[0], tuple):
            for part in ("force", "torque"):
                yield part, np.array([getattr(r, part) for r in ours]), self.arrays[f"{key}__{part}{branch}"]
        else:
            yield "out", np.array(ours), self.arrays[f"{key}__out{branch}"]
