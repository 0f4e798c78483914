"""The cases of `tactemu bench physics`: sensors, scenes, and poses that differ and move.

There are two scenes. In the first a ball is 1 mm deep in a pad of 40 mm, and a quarter of the taxels are in contact. In
*Genesis's scene*, in which Genesis (genesis-world 1.4.5) was measured, the ball is 2 mm deep in a grid of 24 mm, and
nearly all taxels are in contact. Only figures of that scene are compared with those of Genesis.
"""

# pyright: reportInvalidTypeForm=false

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.base.option_groups import from_flat
from tactemu.geometry.shapes.box import Box
from tactemu.geometry.shapes.mesh import Mesh
from tactemu.geometry.shapes.sphere import Sphere
from tactemu.plan.launches import record
from tactemu.scene.scene import Scene
from tactemu.sensors.models import MODELS, model_class
from tactemu.sensors.sensor_model import SensorModel

SIDE = 0.04


@dataclass(frozen=True, kw_only=True)
class Case:
    """One line of the table."""

    sensor: str
    """A key of :func:`sensors`."""
    side: int
    """Number of taxels along a side of the grid."""
    n_envs: int = 1
    aim_us: float | None = None
    genesis_us: float | None = None
    """The time of Genesis in the same scene, on a machine of this kind."""
    mesh: bool = False
    """True if the ball is a mesh of 80k faces."""
    query: str | None = None
    """The method that finds depth (``depth_query``); None: the default."""
    scene: Literal["ours", "genesis"] = "ours"
    spread_mm: float | None = None
    """The spread of the environments' poses along x and y (1 mm in depth), which then move in each step; None: all
    poses are equal and constant."""

    @property
    def title(self) -> str:
        """The title of the case in the table."""
        envs = f", {self.n_envs} envs" if self.n_envs > 1 else ""
        where = " on a mesh" if self.mesh else ""
        where += f" by {self.query}" if self.query else ""
        where += " in Genesis's scene" if self.scene == "genesis" else ""
        apart = "" if self.spread_mm is None else f", ±{self.spread_mm:g} mm apart"
        return f"{self.sensor}{where}, {self.side**2} taxels{envs}{apart}"


def sensors() -> dict[str, tuple[type[SensorModel], Mapping[str, Any]]]:
    """Return the measured sensors by their name in the table: a model, and its options besides the probes."""
    return {
        f"{model.__name__}{words}": (model, options)
        for model in map(model_class, MODELS)
        for words, options in model.examples.items()
    }


CPU_CASES = (
    Case(sensor="KinematicTaxel", side=16, aim_us=40),
    Case(sensor="ContactDepthProbe", side=16, aim_us=30),
    Case(sensor="ElastomerTaxel with shear", side=16, aim_us=250),
    Case(sensor="ProximityTaxel, 500 points", side=16, aim_us=100),
    Case(sensor="KinematicTaxel", side=64, aim_us=250),
    Case(sensor="ContactDepthProbe", side=64, aim_us=200),
    Case(sensor="ElastomerTaxel with shear", side=64, aim_us=2000),
    Case(sensor="ProximityTaxel, 500 points", side=64, aim_us=1000),
    Case(sensor="KinematicTaxel", side=64, n_envs=64, aim_us=6000),
    Case(sensor="ContactDepthProbe", side=64, n_envs=64, aim_us=1320),
    Case(sensor="ElastomerTaxel with shear", side=64, n_envs=64, aim_us=13600),
    Case(sensor="ProximityTaxel, 500 points", side=64, n_envs=64, aim_us=26000),
    Case(sensor="ContactDepthProbe", side=16, mesh=True, aim_us=300),
    Case(sensor="ContactDepthProbe", side=64, n_envs=64, scene="genesis", aim_us=900, genesis_us=8100),
    Case(sensor="KinematicTaxel", side=64, n_envs=64, scene="genesis", aim_us=2500, genesis_us=36400),
    Case(sensor="ProximityTaxel, 500 points", side=64, n_envs=64, scene="genesis", aim_us=14000, genesis_us=137000),
    Case(sensor="ElastomerTaxel with shear", side=64, n_envs=64, scene="genesis", aim_us=9000, genesis_us=63000),
)

GPU_CASES = (
    Case(sensor="KinematicTaxel", side=16, n_envs=4096, spread_mm=1, aim_us=20),
    Case(sensor="KinematicTaxel", side=32, n_envs=4096, spread_mm=1, aim_us=60),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, spread_mm=1, aim_us=12),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, mesh=True),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, mesh=True, spread_mm=1, aim_us=800),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, mesh=True, spread_mm=10, aim_us=930),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, mesh=True, query="band", spread_mm=10, aim_us=120),
    Case(sensor="ProximityTaxel, 500 points", side=16, n_envs=4096, spread_mm=1, aim_us=150),
    Case(sensor="ElastomerTaxel", side=32, n_envs=4096, spread_mm=1, aim_us=240),
    Case(sensor="ElastomerTaxel with shear", side=32, n_envs=4096, spread_mm=1, aim_us=390),
    Case(sensor="KinematicTaxel", side=16, n_envs=4096, scene="genesis", genesis_us=760),
    Case(sensor="KinematicTaxel", side=32, n_envs=4096, scene="genesis", genesis_us=1480),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, scene="genesis", genesis_us=570),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, scene="genesis", mesh=True, genesis_us=8960),
    Case(sensor="ProximityTaxel, 500 points", side=16, n_envs=4096, scene="genesis", aim_us=150, genesis_us=940),
    Case(sensor="ElastomerTaxel", side=32, n_envs=4096, scene="genesis", aim_us=240, genesis_us=2380),
    Case(sensor="ElastomerTaxel with shear", side=32, n_envs=4096, scene="genesis", aim_us=390, genesis_us=3930),
)


def all_cases(device: str) -> list[Case]:
    """Return the cases with a target, and one for each other sensor."""
    aimed = CPU_CASES if device == "cpu" else GPU_CASES
    named = {case.sensor for case in aimed}
    return [*aimed, *(Case(sensor=name, side=16, n_envs=aimed[0].n_envs) for name in sensors() if name not in named)]


def grid(side: int) -> np.ndarray:
    """Return ``side * side`` probes on the top of the pad [m], shape ``(side, side, 3)``."""
    x = (np.arange(side) - (side - 1) / 2) * (SIDE / side)
    return np.stack([*np.meshgrid(x, x), np.full((side, side), 0.01)], -1)


GENESIS_OPTIONS: dict[str, dict[str, Any]] = {
    "KinematicTaxel": {"radius": 3e-3},
    "ContactDepthProbe": {"radius": 3e-3},
    "ProximityTaxel": {"radius": 6e-3, "shear_coupling": 1.0},
    "ElastomerTaxel": {"radius": 3e-3, "lambda_d": 20000.0, "lambda_s": 8000.0},
}
"""Additional options of each model in Genesis's scene, besides those of :func:`sensors`."""


def build(case: Case, device: str, **options: Any):
    """Return ``(sim, ball, sensor)`` of a case with the ball pressed in and sliding; ``options`` go to
    :meth:`Scene.build`."""
    scene = Scene(dt=1e-3)
    kind, chosen = sensors()[case.sensor]
    chosen = {**chosen, "depth_query": case.query} if case.query else chosen
    if case.scene == "genesis":
        place, extent, x = (0.001, 0.002, 0.028), 0.08, np.linspace(-0.012, 0.012, case.side)
        positions = np.stack([*np.meshgrid(x, x), np.full((case.side, case.side), 0.01)], -1)
        chosen = {**chosen, **GENESIS_OPTIONS[kind.__name__]}
    else:
        place, extent, positions = (0.0, 0.0, 0.029), SIDE, grid(case.side)
    pad = scene.add_body(Box(size=(extent, extent, 0.02)), fixed=True, name="pad")
    ball = scene.add_body(_ball(case.mesh), name="ball", position=place)
    sensor = scene.add_sensor(from_flat(kind, {"positions": positions, **chosen}), link=pad, name="skin")
    sim = scene.build(case.n_envs, device=device, **options)
    sim.set_pose(ball, linear_velocity=(0.01, 0, 0))
    sim.step()
    sim.set_pose(ball, position=(place[0] + 0.001, *place[1:]))
    sim.step()
    sim.step()
    sensor.read()
    return sim, ball, sensor


def _ball(mesh: bool):
    if not mesh:
        return Sphere(radius=0.02)
    import trimesh

    return Mesh(source=trimesh.creation.icosphere(6, radius=0.02))


@warp_kernel
def _move_kernel(
    start: wp.array2d(dtype=wp.float64),
    body: int,
    turn: wp.array(dtype=wp.int32),
    poses: wp.array3d(dtype=wp.float64),
):
    """Move the ball to and fro by 10 µm a step along x, 32 steps each way, and by 1 µm in depth."""
    e = wp.tid()
    k = turn[0] % 64
    far = wp.float64(wp.min(k, 64 - k))
    poses[e, body, 0] = start[e, 0] + wp.float64(1.0e-5) * far
    poses[e, body, 1] = start[e, 1]
    poses[e, body, 2] = start[e, 2] - wp.float64(1.0e-6) * far


@warp_kernel
def _next_kernel(turn: wp.array(dtype=wp.int32)):
    turn[0] = turn[0] + 1


class Mover:
    """A callable that moves the ball of each environment on the device; call it before each timed step."""

    def __init__(self, case: Case, sim: Any, ball: Any):
        poses, away = sim.pose_array, np.random.default_rng(7).uniform(-1e-3, 1e-3, (case.n_envs, 3))
        spread = 0.0 if case.spread_mm is None else case.spread_mm
        start = sim.pose(ball).position + away * (spread, spread, 1.0 if spread else 0.0)
        turn = wp.zeros(1, dtype=wp.int32, device=sim.device)
        inputs = [wp.array(start, dtype=wp.float64, device=sim.device), ball.index, turn]
        self._move = record(_move_kernel, case.n_envs, inputs, [poses], sim.device)
        self._next = record(_next_kernel, 1, [], [turn], sim.device)
        self._moves = case.spread_mm is not None

    def __call__(self) -> None:
        """Move the balls to their poses of the next step; do nothing in a case of constant poses."""
        if self._moves:
            self._next()
            self._move()


@warp_kernel
def busy_kernel(n: int, out: wp.array(dtype=wp.float32)):
    """Keep a GPU busy while the steps to be timed are queued."""
    x = float(1.0)
    for _ in range(n):
        x = 0.999 * x + 0.1
    out[0] = x
