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
from tests.hands.holding import ALL, contact_forces, controller, engine_of, scene_of, until

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(90)]
GRIPPER = ALL["paxini_gripper"]
SAMPLE_S = 1 / 90
SLIP = 2
FINE = ("oversampling = 10", "oversampling = 11")
"""30 x 30 cells on each pad run in real time with ease; 33 x 33 take twice as long."""


@dataclass
class Witness:
    """What happens in the model, step by step."""

    engine: object
    rows: list[tuple[float, float, float, np.ndarray]] = field(default_factory=list)
    """Time on this machine's clock, share of touching taxels that slip, height of the object, forces on the pads."""

    def __call__(self, simulation, t_s: float) -> None:
        readings = [pad.sensor.read_ground_truth().slip for pad in self.engine.pads.values()]
        slip = np.concatenate([reading.ravel() for reading in readings])
        share = float((slip == SLIP).sum() / max((slip > 0).sum(), 1))
        height = float(self.engine.data.body("object").xpos[2])
        self.rows.append((time.monotonic(), share, height, contact_forces(self.engine, GRIPPER.pads)))


def said(process, word: str) -> dict:
    """The next line with this word."""
    for line in process.stdout:
        if line.startswith("{") and word in (words := json.loads(line)):
            return words
    raise AssertionError(process.stderr.read()[-2000:])


@pytest.mark.parametrize(
    ("speed", "grid"), [(0.1, FINE[0]), *(pytest.param(v, g, marks=pytest.mark.nightly) for v in (0.03, 0.1) for g in FINE)]
)
def test_slip_is_noticed_and_stopped(speed, grid, tmp_path):
    """A hook on a rubber band pulls harder and harder: from 1 N on by 3 or 10 N in a second, up to 5 N."""
    scene = scene_of(GRIPPER, "pulled", tmp_path)
    scene.write_text(scene.read_text().replace(FINE[0], grid))
    with tt.serve(scene) as dev:
        engine = engine_of(dev)
        witness = Witness(engine)
        with controller(GRIPPER, dev, "--seconds", 60) as process:
            said(process, "touched")
            until(engine, engine.data.time + 1.0)
            dev.move((0, 0, -0.2), body="table", speed=0.3)
            dev.in_loop(lambda: dev.simulation.posers.append(witness))
            until(engine, engine.data.time + 1.0)
            rest = engine.data.body("object").xpos[2]
            assert max(share for _, share, _, _ in witness.rows) < 0.1, "nothing slips yet"
            dev.move((0, 0, -0.02), body="hook", speed=speed, wait=False)
            noticed = said(process, "slips")["slips"]
            until(engine, engine.data.time + 0.04 / speed + 0.5)
            behind = engine.behind_s
    slipped = [(at, share) for at, share, _, _ in witness.rows if share >= 0.1]
    fallen = rest - min(height for _, _, height, _ in witness.rows)
    last = witness.rows[-1]
    print(f"{speed} {grid} noticed {noticed - slipped[0][0] if slipped else float('nan'):+.4f} s, fell {fallen * 1e3:.3f} mm, {last} behind {behind} n {len(slipped)}")
    assert slipped, "without slip there is nothing to notice"
    assert noticed < slipped[0][0] + 0.02 + 2 * SAMPLE_S
    assert fallen < 2e-3


@pytest.mark.parametrize("end", [0.0, *(pytest.param(e, marks=pytest.mark.nightly) for e in np.linspace(-8, 8, 10))])
def test_the_end_of_a_plate_is_found(end, tmp_path):
    with tt.serve(scene_of(GRIPPER, "plate", tmp_path)) as dev:
        dev.move((end * 1e-3, 0, 0.065), body="plate")
        with controller(GRIPPER, dev, does="edge") as process:
            found = said(process, "edge")["edge"]
    print(f"{end:+.3f} mm found at {found * 1e3:+.3f}")
    assert abs(found - end * 1e-3) < 2e-3
