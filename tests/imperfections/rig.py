"""A sensor made of imperfections alone: arrays go in, readings come out, step by step."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import warp as wp

from tactemu.base.words import in_our_words
from tactemu.imperfections import ChainOptions, Imperfections, ReadingInfo
from tactemu.plan.plan import Context

DATA = Path(__file__).parents[1] / "data" / "imperfections"


def info(
    layout=(4, 4), channels=("scalar",), *, radius=0.002, spacing=(0.002, 0.002), name="skin", **more
) -> ReadingInfo:
    n = int(np.prod(layout))
    radii = np.broadcast_to(np.asarray(radius, dtype=float).reshape(-1), (n,)).copy()
    return ReadingInfo(
        name=name,
        layout=tuple(layout),
        channels=channels,
        radius=radii,
        spacing=spacing,
        normal=(0.0, 0.0, 1.0),
        **more,
    )


class Rig:
    """Runs the chain of one sensor. ``step(raw)`` takes one step and returns the reading, without unused axes."""

    def __init__(self, options, about=None, *, n_envs=1, real=wp.float64, dt=1e-3, seed=0, step=0, device="cpu"):
        self.info = about or info()
        self.device, self.dt_ns = wp.get_device(device), round(dt * 1e9)
        self.context = Context(device=self.device, n_envs=n_envs, real=real, seed=seed)
        self.context.dt.fill_(dt)
        self.context.step.fill_(step)
        self.context.time_ns.fill_(step * self.dt_ns)
        self.number, self.now = step, step * self.dt_ns
        self.raw = wp.zeros((n_envs, self.info.n_taxels, self.info.n_channels), dtype=real, device=self.device)
        self.chain = Imperfections(options, self.info, self.context)
        self.gain, before = self.chain.compile_gain()
        self.radius, radius = self.chain.compile_radius_noise()
        self.measured, values = self.chain.compile_values(self.raw)
        self.reading, delivery = self.chain.compile_delivery(self.measured)
        self.stages = before + radius + values + delivery

    def step(self, raw=None, dt_ns: int | None = None) -> np.ndarray:
        """One step with raw readings that broadcast to ``(n_envs, n_taxels, n_channels)``."""
        if raw is not None:
            self.raw.assign(np.broadcast_to(np.asarray(raw, dtype=float), self.raw.shape))
        dt_ns = self.dt_ns if dt_ns is None else dt_ns
        self.number, self.now = self.number + 1, self.now + dt_ns
        self.context.step.assign([self.number])
        self.context.time_ns.assign([self.now])
        self.context.dt.assign([dt_ns * 1e-9])
        for stage in self.stages:
            stage.launch()
        return self.reading.numpy().copy()

    def run(self, steps: int, raw=None) -> np.ndarray:
        """Readings ``(steps, ...)``; ``raw`` is given once or stays."""
        first = self.step(raw)
        out = np.empty((steps, *first.shape), dtype=first.dtype)
        out[0] = first
        for k in range(1, steps):
            out[k] = self.step()
        return out

    def reset(self, envs=None) -> None:
        mask = np.zeros(self.context.n_envs, dtype=bool)
        mask[slice(None) if envs is None else envs] = True
        array = wp.array(mask, dtype=wp.bool, device=self.device)
        self.context.begin(array)
        for stage in self.stages:
            if stage.reset is not None:
                stage.reset(array)

    def restart(self) -> None:
        """Counts time and steps from 0 again, as a reset of all environments does."""
        self.number = self.now = 0
        self.context.step.assign([0])
        self.context.time_ns.assign([0])


def options(**given) -> ChainOptions:
    return ChainOptions(**given)


class Case:
    """Readings of a reference case (see ``tests/data/imperfections/README.md``)."""

    def __init__(self, name: str):
        self.arrays = np.load(DATA / f"{name}.npz")
        self.facts = json.loads((DATA / f"{name}.json").read_text())
        self.sensors = {s["key"]: s | {"options": in_our_words(s["options"])} for s in self.facts["sensors"]}

    def raw(self, key: str) -> np.ndarray:
        """A sensor's readings ``(T, n_envs, n_taxels, n_channels)``; a suffix ``_gt`` names the ground truth."""
        suffix = "_gt" if key.endswith("_gt") else ""
        key = key.removesuffix("_gt")
        a = self.arrays
        if f"{key}__out{suffix}" in a:
            parts = [a[f"{key}__out{suffix}"][..., None]]
        else:
            parts = [a[f"{key}__force{suffix}"], a[f"{key}__torque{suffix}"]]
        joined = np.concatenate(parts, axis=-1)
        n_envs = max(1, self.facts["n_envs"])
        n = np.prod(np.asarray(self.sensors[key]["options"]["positions"]).shape[:-1])
        return joined.reshape(len(joined), n_envs, -1, n, joined.shape[-1])[:, :, 0]

    def history(self, key: str) -> np.ndarray:
        """Readings with a history ``(T, n_envs, history, n_taxels, n_channels)``."""
        a = self.arrays
        parts = [a[f"{key}__out"][..., None]] if f"{key}__out" in a else [a[f"{key}__force"], a[f"{key}__torque"]]
        joined = np.concatenate(parts, axis=-1)
        return joined.reshape(len(joined), 1, joined.shape[1], -1, joined.shape[-1])

    def info(self, key: str) -> ReadingInfo:
        given = self.sensors[key]["options"]
        pos = np.asarray(given["positions"], dtype=float)
        scalar = self.sensors[key]["type"] == "ContactDepthProbe"
        u, v = (np.diff(pos, axis=1).reshape(-1, 3).mean(0), np.diff(pos, axis=0).reshape(-1, 3).mean(0))
        return info(
            pos.shape[:2],
            ("scalar",) if scalar else ("force", "torque"),
            radius=given["radius"],
            spacing=(float(np.linalg.norm(u)), float(np.linalg.norm(v))),
            name=key,
        )

    def options(self, key: str, *leave_out: str) -> ChainOptions:
        """The sensor's own options, as far as they are imperfections."""
        known = ChainOptions.__dataclass_fields__
        given = self.sensors[key]["options"]
        return ChainOptions(**{k: v for k, v in given.items() if k in known and k not in leave_out})
