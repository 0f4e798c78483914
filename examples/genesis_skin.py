"""Genesis's own taxels behind a driver: tactemu sends the readings of Genesis's sensor and simulates no contact.

pip install genesis-world torch
python examples/genesis_skin.py

A ball drops on a pad with a KinematicTaxel of Genesis at the positions of AnySkin's five chips.
"""

from __future__ import annotations

import threading

import genesis as gs
import numpy as np
import serial

import firmware_protocols
import tactemu as tt

FRAME = 82
TOP = 0.01
"""Height of the pad's top [m]."""


def build():
    """Build a scene with a pad, a ball above it and a sensor on the pad; return the scene and the sensor."""
    gs.init(backend=gs.cpu, logging_level="warning")
    scene = gs.Scene(sim_options=gs.options.SimOptions(dt=0.002), show_viewer=False)
    pad = scene.add_entity(gs.morphs.Box(size=(0.03, 0.03, TOP), pos=(0, 0, TOP / 2), fixed=True))
    scene.add_entity(gs.morphs.Sphere(radius=0.01, pos=(0, 0, TOP + 0.02)))
    chips = firmware_protocols.create("anyskin").layout.positions
    taxels = gs.sensors.KinematicTaxel(
        entity_idx=pad.idx,
        probe_local_pos=(chips + np.array([0, 0, TOP / 2 - 0.001])).tolist(),
        probe_radius=0.003,
        normal_stiffness=1000.0,
        shear_scalar=0.0,
    )
    sensor = scene.add_sensor(taxels)
    scene.build()
    return scene, sensor


class GenesisSource(threading.Thread):
    """A source of readings: Genesis runs at its own pace in a thread, and the skin measures its latest reading.

    The sensor's normal force acts on the skin, as devices measure it. Its shear force acts on the body; it is 0 here.
    """

    def __init__(self, scene, sensor):
        super().__init__(daemon=True)
        self.scene, self.sensor, self.stopped = scene, sensor, False
        self.step()  # compiles the kernels before a driver waits for the first frame

    def step(self) -> None:
        self.scene.step()
        self.latest = self.sensor.read().force.cpu().numpy().reshape(-1, 3).astype(float)

    def run(self) -> None:
        while not self.stopped:
            self.step()

    def __call__(self, t_s: float) -> np.ndarray:
        return self.latest


def main() -> None:
    source = GenesisSource(*build())
    source.start()
    with tt.serve("anyskin", source=source, rate_hz=50) as dev:
        with serial.Serial(dev.port, 115_200, timeout=10) as port:
            frames = [port.read(FRAME) for _ in range(100)]
        forces = [-float(np.asarray(sample.ideal)[:, 2].sum()) for sample in dev.truth.samples]
    source.stopped = True
    source.join()
    fields = np.array([np.frombuffer(frame[:80], "<f4").reshape(5, 4)[0, 3] for frame in frames])
    print(f"{len(frames)} frames; Bz of the middle chip from {fields.min():.0f} to {fields.max():.0f} µT")
    print(f"the largest force on the skin was {max(forces):.2f} N")


if __name__ == "__main__":
    main()
