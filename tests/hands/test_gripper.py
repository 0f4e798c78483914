"""A gripper that feels shear, with PaXini's and Feetech's SDKs in a process of their own: slip, and the end of a plate.

MuJoCo's forces and the slip state of the skin's model are what it is judged by.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

import json
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

import tactemu as tt
from tests.hands.holding import ALL, controller, engine_of, scene_of, until

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(90)]
GRIPPER = ALL["paxini_gripper"]
SAMPLE_S = 1 / 90
SLIP = 2


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
            rest = float(engine.data.body("object").xpos[2])
            assert not witness.slips(), "nothing slips yet"
            dev.move((0, 0, -0.02), body="hook", speed=0.1, wait=False)
            noticed = said(process, "slips")["slips"] if not options else np.nan
            until(engine, engine.data.time + 1.0)
            missed = dev.stats("pads")["skins"]["pads"]["missed"]
    first = witness.slips()[:1]
    fallen = rest - min(height for _, _, height in witness.rows)
    return Pulled(noticed - first[0] if first else None, fallen, missed)


@pytest.mark.parametrize("split", [5, pytest.param(10, marks=pytest.mark.nightly)])
def test_slip_is_noticed_and_stopped(split, tmp_path):
    """15 or 30 cells along each side of a pad."""
    held = pulled(tmp_path, split)
    assert held.noticed_s is None or held.noticed_s < 0.02 + 2 * SAMPLE_S, held
    assert held.fallen_m < 2e-3, held


@pytest.mark.nightly
def test_what_does_not_grip_harder_loses_it(tmp_path):
    """The same pull, and a controller that takes the pads for stickier than they are."""
    lost = pulled(tmp_path, 5, "--friction", 100)
    assert lost.fallen_m > 5e-3


@pytest.mark.parametrize("end", [pytest.param(end, marks=pytest.mark.nightly) for end in np.linspace(-8, 8, 10)])
def test_the_end_of_a_plate_is_found(end, tmp_path):
    with tt.serve(scene_of(GRIPPER, "plate", tmp_path)) as dev:
        dev.move((end * 1e-3, 0, 0.065), body="plate")
        with controller(GRIPPER, dev, does="edge") as process:
            found = said(process, "edge")["edge"]
    assert abs(found - end * 1e-3) < 2e-3
