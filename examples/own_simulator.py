"""Your own simulator behind a driver: first it gives the pose of a ball, then the readings of the skin.

The simulator is a ball on a spring in ten lines of Python. With poses, ``tactemu`` computes the contact of the ball
with an AnySkin; with readings, the simulator computes the forces itself. The driver reads the same format of frames.
"""

from __future__ import annotations

import numpy as np
import serial

import tactemu as tt

FRAME = 82
CHIPS = np.array([[0.0, 0.0], [-0.007, 0.0], [0.007, 0.0], [0.0, 0.007], [0.0, -0.007]])
"""Positions of AnySkin's five chips [m], in the order in which it sends them."""
TOUCHES = 0.023
"""Height of the ball's centre at which it touches the skin [m], in AnySkin's default scene."""


class Spring:
    """A ball that swings up and down [m]: 1.5 Hz, 3 mm to either side."""

    def __init__(self, dt: float = 1e-4):
        self.t_s, self.dt = 0.0, dt
        self.height, self.speed = 0.003, 0.0

    def height_at(self, t_s: float) -> float:
        """Integrate up to ``t_s``, which never falls."""
        while self.t_s < t_s:
            self.speed -= (2 * np.pi * 1.5) ** 2 * self.height * self.dt
            self.height += self.speed * self.dt
            self.t_s += self.dt
        return self.height


def poses_of(spring: Spring):
    """Return a source of poses for the ball of AnySkin's default scene: its lowest point swings from 5 mm above to 1 mm
    below the skin."""
    return lambda t_s: {"ball": ((0.0, 0.0, TOUCHES + 0.002 + spring.height_at(t_s)), (1.0, 0.0, 0.0, 0.0))}


def readings_of(spring: Spring):
    """Return a source of readings: the force on each chip [N], which falls off with its distance from the ball."""

    def forces(t_s: float) -> np.ndarray:
        push = 300.0 * max(0.0, -spring.height_at(t_s)) * np.exp(-((CHIPS**2).sum(1) / 0.005**2))
        return np.stack([0 * push, 0 * push, -push], axis=-1)

    return forces


def read(title: str, source) -> None:
    """Read for a second, as a driver does, and print the range of the middle chip's field."""
    with tt.serve("anyskin", source=source, rate_hz=100) as dev:
        with serial.Serial(dev.port, 115_200, timeout=2) as port:
            frames = [port.read(FRAME) for _ in range(100)]
        deepest = min(float(np.asarray(sample.ideal)[0, 2]) for sample in dev.truth.samples)
    fields = np.array([np.frombuffer(frame[:80], "<f4").reshape(5, 4)[0, 3] for frame in frames])
    print(f"{title}: {len(frames)} frames; Bz of the middle chip from {fields.min():.0f} to {fields.max():.0f} µT")
    print(f"  the largest force on the skin was {-deepest:.2f} N")


def main() -> None:
    read("poses", poses_of(Spring()))
    read("readings", readings_of(Spring()))


if __name__ == "__main__":
    main()
