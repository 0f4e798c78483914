"""A gripper that feels shear, with PaXini's and Feetech's SDKs in a process of their own: slip, and the end of a plate.

MuJoCo's forces and the slip state of the skin's model are what it is judged by.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

import json
import time
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.scene.steering import steered
from tests.hands.holding import ALL, contact_forces, controller, engine_of, scene_of, until

GRIPPER = ALL["paxini_gripper"]
SAMPLE_S = 1 / 90
SLIP, MS = 2, 1_000_000
FEW = 10
"""Of some 180 samples, those that a machine may be too slow for."""


def live(test):
    """In real time, with the drivers in a process of their own; each night."""
    for mark in (pytest.mark.driver, pytest.mark.nightly, pytest.mark.timeout(90)):
        test = mark(test)
    return test


def packet(servo: int, register: int, *values: int) -> bytes:
    """A write to a servo, two bytes each; of torque, one."""
    data = b"".join(value.to_bytes(2, "little") for value in values) if register != 40 else bytes(values)
    body = bytes([servo, len(data) + 3, 3, register]) + data
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def test_what_hangs_weighs_on_the_pads_and_slips_at_their_rims_first(tmp_path):
    """In virtual time, by a script: 1.98 N on each pad, and a pull of 10 N more in a second."""
    loaded = steered(file.load(scene_of(GRIPPER, "pulled", tmp_path)))
    whole = assemble(loaded, AssemblyOptions(port="memory:"), clock=VirtualClock())
    emulator, simulation, engine = whole.emulator, whole.simulation, whole.simulation.posers[0].__self__
    bodies = {body.name: body.motion for body in simulation.bodies}
    write, slips, object_ = emulator.channels[0].wire.transport.driver.write, [], engine.data.body("object")
    orders = (packet(6, 46, 1500), packet(6, 42, 2048 + 575), packet(6, 40, 1), packet(1, 40, 1))
    later = (packet(6, 48, 27), packet(6, 46, 250), packet(6, 42, 2048 + 1400))
    with emulator:
        for k, order in enumerate(orders):
            emulator.at((10 + 10 * k) * MS, partial(write, order))
        for k, order in enumerate(later):
            emulator.at((600 + 10 * k) * MS, partial(write, order))
        emulator.run(1.5)
        bodies["table"].put(1.5, position=(0, 0, -0.3))
        emulator.run(0.5)
        rest, weight = object_.xpos[2], 0.1 * 9.81
        drag = sum(pad.sensor.quantity("force", ground_truth=True).sum(axis=0)[2] for pad in engine.pads.values())
        felt = [pad.skin_force() for pad in engine.pads.values()]
        for k in range(30):
            bodies["hook"].put(2.0 + 0.008 * k, position=(0, 0, 0.02 - 0.0008 * k))
            emulator.run(0.008)
            load = weight + 100 * (engine.data.ten_length[0] - 0.0452)
            slip = np.concatenate([pad.sensor.read_ground_truth().slip.ravel() for pad in engine.pads.values()])
            if object_.xpos[2] > rest - 1e-4:
                slips.append((load / (0.8 * contact_forces(engine, GRIPPER.pads).sum()), (slip == SLIP).mean()))
    np.testing.assert_allclose(felt, 1.98, rtol=0.02)
    assert abs(-drag - weight) < 0.05 * weight, "what it weighs is felt"
    assert max(share for load, share in slips if load < 0.5) == 0, "nothing slips under half of what friction holds"
    assert any(0.1 <= share < 1 for load, share in slips if load < 0.98), "a part slips before all does"


@dataclass
class Witness:
    """What happens in the model, step by step."""

    dev: tt.Served
    rows: list[tuple[float, float, float]] = field(default_factory=list)
    """Time on this machine's clock, share of touching taxels that slip, height of the object."""

    def __call__(self, simulation, t_s: float) -> None:
        engine, clock = engine_of(self.dev), self.dev.emulator.clock
        readings = [pad.sensor.read_ground_truth().slip for pad in engine.pads.values()]
        slip = np.concatenate([reading.ravel() for reading in readings])
        share = float((slip == SLIP).sum() / max((slip > 0).sum(), 1))
        height = float(engine.data.body("object").xpos[2])
        at = time.monotonic() + simulation.time_ns * 1e-9 - clock.now_ns() * 1e-9  # of the step that was felt
        self.rows.append((at, share, height))

    def slips(self) -> list[float]:
        """When a tenth of what touches slips, or more."""
        return [at for at, share, _ in self.rows if share >= 0.1]


def said(process, word: str) -> dict:
    """The next line with this word."""
    for line in process.stdout:
        if line.startswith("{") and word in (words := json.loads(line)):
            return words
    raise AssertionError(process.stderr.read()[-2000:])


@dataclass
class Pulled:
    """What came of a pull."""

    noticed_s: float | None
    """After the first sample in which a tenth of what touches slips; negative: before it; none did."""
    fallen_m: float
    missed: int
    """Samples that the machine was too slow for."""


def pulled(folder, split: int, *options) -> Pulled:
    """Hold a box that hangs on a rubber band, whose end is pulled down: 10 N more in a second, up to 5 N."""
    scene = scene_of(GRIPPER, "pulled", folder)
    scene.write_text(scene.read_text().replace("oversampling = 5", f"oversampling = {split}"))
    with tt.serve(scene) as dev:
        engine, witness = engine_of(dev), Witness(dev)
        with controller(GRIPPER, dev, "--seconds", 60, *options) as process:
            said(process, "touched")
            until(engine, engine.data.time + 1.0)
            dev.move((0, 0, -0.2), body="table", speed=0.3)
            dev.in_loop(lambda: dev.simulation.posers.append(witness))
            until(engine, engine.data.time + 1.0)
            before = dev.stats("pads")["skins"]["pads"]["missed"]
            rest = float(engine.data.body("object").xpos[2])
            assert not witness.slips(), "nothing slips yet"
            dev.move((0, 0, -0.02), body="hook", speed=0.1, wait=False)
            noticed = said(process, "slips")["slips"] if not options else np.nan
            until(engine, engine.data.time + 1.0)
            missed = dev.stats("pads")["skins"]["pads"]["missed"] - before
    first = witness.slips()[:1]
    fallen = rest - min(height for _, _, height in witness.rows)
    return Pulled(noticed - first[0] if first else None, fallen, missed)


@live
@pytest.mark.parametrize("split", [5, 10])
def test_slip_is_noticed_and_stopped(split, tmp_path):
    """15 or 30 cells along each side of a pad. A machine that is too slow for the pads' rate is asked again."""
    tries = (pulled(tmp_path, split) for _ in range(3))
    held = next((each for each in tries if each.missed <= FEW), None)
    assert held is not None, "the machine misses many samples"
    assert held.noticed_s is None or held.noticed_s < 0.02 + 2 * SAMPLE_S, held
    assert held.fallen_m < 2e-3, held


@live
def test_what_does_not_grip_harder_loses_it(tmp_path):
    """The same pull, and a controller that takes the pads for stickier than they are."""
    lost = pulled(tmp_path, 5, "--friction", 100)
    assert lost.fallen_m > 5e-3


@live
@pytest.mark.parametrize("end", np.linspace(-8, 8, 10))
def test_the_end_of_a_plate_is_found(end, tmp_path):
    with tt.serve(scene_of(GRIPPER, "plate", tmp_path)) as dev:
        dev.move((end * 1e-3, 0, 0.065), body="plate")
        with controller(GRIPPER, dev, does="edge") as process:
            found = said(process, "edge")["edge"]
    assert abs(found - end * 1e-3) < 2e-3
