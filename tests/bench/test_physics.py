"""Smoke tests: `tactemu bench physics` measures what it says; how fast is no matter for a test."""

import json

import pytest

from tactemu.bench import physics


@pytest.mark.parametrize("sensor", physics.sensors())
def test_every_sensor_can_be_measured_in_contact(sensor):
    case = physics.Case(sensor=sensor, side=8, n_envs=2, aim_us=1.0, genesis_us=2.0)
    sim, _ball, skin = physics.build(case, "cpu")
    assert sim.step_count == 3 and abs(skin.array().numpy()).max() > 0
    figure = physics.measure(case, repeats=5)
    assert figure.step_us > 0 and figure.read_us > 0 and figure.bound_us > 0
    assert str(figure).startswith(f"{sensor}, 64 taxels, 2 envs")


def test_figures_go_to_a_file(tmp_path):
    from typer.testing import CliRunner

    from tactemu.cli.app import app

    out = tmp_path / "figures.json"
    words = ["bench", "physics", "--no-starts", "--only", "ContactDepthProbe, 256", "--out", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    (figure,) = json.loads(out.read_text()).values()
    assert figure["aim_us"] == 30 and figure["step_us"] > 0 and figure["read_us"] > 0
