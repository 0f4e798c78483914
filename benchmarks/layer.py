"""The time of the elastic layer: `python -m benchmarks layer`.

It measures three things: a warm step (a ball that presses deeper and slides by hundredths of a millimetre) on growing
grids, with and without friction; the dependence on the size of the contact and of the skin; and batches of environments
on a GPU. Times are medians; on a CPU those of the thread, so that other processes do not count.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from statistics import median

import numpy as np

import tactemu as tt
from tactemu.tune.timing import Report, timed_step

TOP = 0.005
STEPS = 40
WARM_UP = 8


@dataclass(frozen=True, kw_only=True)
class Case:
    """A square skin and a ball on it."""

    title: str
    side: int
    """Number of taxels along a side."""
    pitch: float
    radius: float
    """The radius of the ball [m]."""
    friction: float = 0.0
    n_envs: int = 1
    displacement: bool = False
    aim_ms: float | None = None
    """The target for the solver's stages together."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """The measured figures of a case."""

    title: str
    step_ms: float
    """The time of a complete step: poses, overlap, solvers, reading."""
    still_ms: float
    """The time of a step in which nothing moves."""
    contact: float
    """The share of taxels in contact."""
    residual: float
    aim_ms: float | None

    def __str__(self) -> str:
        aim = "" if self.aim_ms is None else f"  aim {self.aim_ms:g}"
        return (
            f"{self.title:<44} {self.step_ms:8.3f} ms{aim:<10}  still {self.still_ms:.3f} ms  "
            f"contact {self.contact:5.1%}  residual {self.residual:.1e}"
        )


def cases(device: str, n_envs: int) -> list[Case]:
    """Return all cases; those of many environments only with ``n_envs`` above 1."""
    found = []
    for side, pitch, radius, aim in ((16, 1e-3, 0.02, 0.3), (64, 5e-4, 0.06, 2.0), (256, 1.25e-4, 0.06, 40.0)):
        found.append(Case(title=f"{side} x {side}", side=side, pitch=pitch, radius=radius, aim_ms=aim))
        title = f"{side} x {side}, friction"
        found.append(Case(title=title, side=side, pitch=pitch, radius=radius, friction=0.5, aim_ms=5 * aim))
    for side in (32, 64, 128, 256):
        found.append(Case(title=f"skin grows: {side} x {side}", side=side, pitch=5e-4, radius=5e-3))
    for radius in (2.5e-3, 1e-2, 4e-2, 16e-2):
        title = f"contact grows: ball of {radius * 1e3:g} mm on 128 x 128"
        found.append(Case(title=title, side=128, pitch=5e-4, radius=radius))
    if n_envs > 1:
        for friction in (0.0, 0.5):
            title = f"{n_envs} envs of 32 x 32{', friction' if friction else ''}"
            aim = None if device == "cpu" else 2.5 if friction else 0.7
            found.append(
                Case(title=title, side=32, pitch=5e-4, radius=5e-3, n_envs=n_envs, friction=friction, aim_ms=aim)
            )
    return found


def run(report: Report, *, device: str = "cpu", n_envs: int | None = None, only: str = "") -> list[dict]:
    """Measure all cases whose title contains ``only``, with a batch of ``n_envs`` (4096 on a GPU, none on a CPU)."""
    if n_envs is None:
        n_envs = 1 if device == "cpu" else 4096
    figures = []
    for case in cases(device, n_envs):
        if only in case.title:
            figures.append(measure(case, device))
            report(str(figures[-1]))
    return [asdict(figure) for figure in figures]


def measure(case: Case, device: str) -> Figure:
    """Press and slide a ball, and time each step."""
    x = (np.arange(case.side) - (case.side - 1) / 2) * case.pitch
    positions = np.stack([*np.meshgrid(x, x[::-1]), np.full((case.side, case.side), TOP)], -1)
    scene = tt.Scene()
    pad = scene.add_body(None, name="pad", fixed=True)
    ball = scene.add_body(tt.Sphere(radius=case.radius), position=(0, 0, 1))
    options = {"iterations": 16, "tolerance": 1e-4, "friction": case.friction, "displacement": case.displacement}
    skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=positions, **options), link=pad)
    sim = scene.build(n_envs=case.n_envs, device=device)
    depths = 5e-4 * (1 + np.linspace(-0.2, 0.2, case.n_envs)) if case.n_envs > 1 else np.array([5e-4])
    moving, still = [], []
    for k in range(STEPS + WARM_UP):
        height = TOP + case.radius - depths - 2e-6 * k
        sim.set_pose(ball, position=np.stack([np.zeros_like(height), np.full_like(height, 1e-5 * k), height], -1))
        took = timed_step(sim)
        if k >= WARM_UP:
            moving.append(took)
    for _ in range(STEPS):
        still.append(timed_step(sim))
    reading = skin.read()
    return Figure(
        title=case.title,
        step_ms=median(moving) * 1e3,
        still_ms=median(still) * 1e3,
        contact=float((reading.pressure > 0).mean()),
        residual=float(reading.residual.max()),
        aim_ms=case.aim_ms,
    )
