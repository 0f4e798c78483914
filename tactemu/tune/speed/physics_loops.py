"""The time of loops around the step: `tactemu bench physics --loops`.

The first loop is the step alone; the others are those of training: poses in, a step, readings out. Each figure is the
wall time of one turn [µs], in a loop that waits for the device at its end. Lines for torch appear if it is installed.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
import warp as wp

from tactemu.geometry.shapes.box import Box
from tactemu.geometry.shapes.capsule import Capsule
from tactemu.geometry.shapes.sphere import Sphere
from tactemu.scene.scene import Scene
from tactemu.sensors.probes.kinematic_taxel import KinematicTaxel
from tactemu.sensors.sensor import reading_array
from tactemu.tune.speed.physics_cases import Case, Mover, build
from tactemu.tune.timing import Report

ENVS = {"cpu": 64, "cuda": 4096}
SECONDS = 0.5
"""The approximate duration of one timed loop; the figure is the median of three."""
FINGERS, BONES, PADS = 5, 3, (9, 8)

Turn = Callable[[], None]


def run(report: Report, *, device: str = "cpu", only: str = "", n_envs: int | None = None) -> dict[str, dict]:
    """Measure all loops around all scenes whose name contains ``only``, and return the figures by title."""
    figures: dict[str, dict] = {}
    kind = wp.get_device(device)
    envs = n_envs or ENVS["cuda" if kind.is_cuda else "cpu"]
    for name, make in scenes(envs, device).items():
        if only.lower() not in f"loop around {name}".lower():
            continue
        sim, bodies, skins, move = make()
        alone = 0.0
        for way, turn in ways(sim, bodies, skins, move).items():
            us = 1e6 * time_of(turn, sim)
            alone = alone or us
            title = f"loop around {name}, {envs} envs: {way}"
            figures[title] = {"us": us, "turns_per_s": 1e6 / us, "steps": us / alone}
            report(f"{title:<92} {us:10.1f} µs  {1e6 / us:9.0f}/s  {us / alone:6.1f} steps")
        sim.close()
    return figures


def scenes(n_envs: int, device: str) -> dict[str, Callable[[], tuple[Any, list, list, Turn]]]:
    """Return builders of the scenes by name; each gives simulation, moving bodies, skins, and a callable that moves the
    bodies on the device."""

    def of(sensor: str, side: int):
        def make():
            case = Case(sensor=sensor, side=side, n_envs=n_envs, spread_mm=1)
            sim, ball, skin = build(case, device)
            return sim, [ball], [skin], Mover(case, sim, ball)

        return make

    return {
        "KinematicTaxel, 256 taxels": of("KinematicTaxel", 16),
        "ContactDepthProbe, 256 taxels": of("ContactDepthProbe", 16),
        "KinematicTaxel, 1024 taxels": of("KinematicTaxel", 32),
        "ProximityTaxel, 256 taxels": of("ProximityTaxel, 500 points", 16),
        "ElasticLayerTaxel, 256 taxels": of("ElasticLayerTaxel", 16),
        "a hand of 17 bodies, 5 skins of 72": lambda: hand(n_envs, device),
    }


def hand(n_envs: int, device: str):
    """Build a palm, five fingers of three bones with a skin on the last, and a ball, all of them posed in each step."""
    scene = Scene(dt=1e-3)
    bodies = [scene.add_body(Box(size=(0.08, 0.09, 0.02)), name="palm")]
    y, x = (np.linspace(-a, a, n) for a, n in zip((6e-3, 5e-3), PADS))
    pad = np.stack([*np.meshgrid(x, y), np.full(PADS, 6e-3)], -1)
    skins = []
    for finger in range(FINGERS):
        for bone in range(BONES):
            place = (0.02 * (finger - 2), 0.05 + 0.03 * bone, 0.0)
            bodies.append(
                scene.add_body(Capsule(radius=6e-3, length=0.02), name=f"bone {finger} {bone}", position=place)
            )
        model = KinematicTaxel(positions=pad, radius=2e-3)
        skins.append(scene.add_sensor(model, link=bodies[-1], name=f"finger {finger}"))
    bodies.append(scene.add_body(Sphere(radius=0.03), name="ball", position=(0.0, 0.11, 0.035)))
    sim = scene.build(n_envs, device=device)
    poses = sim.pose_array
    start = wp.clone(poses)
    return sim, bodies, skins, lambda: wp.copy(poses, start)


def ways(sim, bodies: list, skins: list, move: Turn) -> dict[str, Turn]:
    """Return the loops by their titles; the first is the step alone."""
    arrays = [reading_array(skin) for skin in skins]
    pinned = [skin.host_array() for skin in skins]
    poses = sim.pose_array
    start = wp.clone(poses)
    host = start.numpy()[:, [body.index for body in bodies]]
    totals = [wp.zeros(1, dtype=array.dtype, device=sim.device) for array in arrays]

    def add_up() -> None:
        for array, total in zip(arrays, totals):
            wp.utils.array_sum(array.flatten(), out=total)

    def from_host() -> None:
        for k, body in enumerate(bodies):
            sim.set_pose(body, position=host[:, k, 0:3], quaternion=host[:, k, 3:7])
        sim.step()

    def plain() -> None:
        from_host()
        for skin in skins:
            skin.read()

    def into_memory() -> None:
        from_host()
        for skin, memory in zip(skins, pinned):
            skin.read(out=memory)

    def moved() -> None:
        move()
        sim.step()
        add_up()

    done = wp.array(np.arange(sim.n_envs) < 3, dtype=wp.bool, device=sim.device)

    def with_resets() -> None:
        sim.reset(done)
        sim.step()
        add_up()

    found = {
        "step": sim.step,
        "NumPy position, quaternion -> step -> read()": plain,
        "NumPy position, quaternion -> step -> read(out=)": into_memory,
        "poses written on the device -> step -> sum": moved,
        "reset of 3 by a mask -> step -> sum": with_resets,
    }
    return found | _with_torch(sim, start, arrays) | _bound(sim, start, add_up)


def _bound(sim, start: wp.array, add_up: Turn) -> dict[str, Turn]:
    """Return the loop with bound poses; it comes last because the binding stays."""
    poses = wp.array(start.numpy(), dtype=wp.float32, device=sim.device)

    bound = []

    def turn() -> None:
        if not bound:
            bound.append(sim.bind_poses(poses))
        sim.step()
        add_up()

    return {"poses bound, float32 -> step -> sum": turn}


def _with_torch(sim, start: wp.array, arrays: list[wp.array]) -> dict[str, Turn]:
    try:
        torch: Any = importlib.import_module("torch")
    except ImportError:
        return {}
    poses, state = torch.from_dlpack(sim.pose_array), torch.from_dlpack(start).clone()
    seen = [torch.from_dlpack(array) for array in arrays]

    def all_parts() -> None:
        poses.copy_(state)
        sim.step()
        for each in seen:
            each.sum()

    return {"torch: all of the poses -> step -> sum": all_parts}


def time_of(turn: Turn, sim) -> float:
    """Return the time of one turn [s]."""
    for _ in range(4):
        turn()
    wp.synchronize_device(sim.device)
    begun = time.perf_counter()
    for _ in range(3):
        turn()
    wp.synchronize_device(sim.device)
    count = max(3, min(2000, int(SECONDS / (time.perf_counter() - begun) * 3)))
    found = []
    for _ in range(3):
        begun = time.perf_counter()
        for _ in range(count):
            turn()
        wp.synchronize_device(sim.device)
        found.append((time.perf_counter() - begun) / count)
    return median(found)
