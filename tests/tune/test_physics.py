"""Smoke tests: `tactemu bench physics` measures what it says; how fast is no matter for a test."""

import json
from dataclasses import replace

import pytest
import warp as wp

from tactemu.sensors.sensor import reading_array
from tactemu.tune.speed import physics, physics_loops


@pytest.mark.parametrize("sensor", physics.sensors())
def test_every_sensor_can_be_measured_in_contact(sensor):
    case = physics.Case(sensor=sensor, side=8, n_envs=2, aim_us=1.0, genesis_us=2.0)
    sim, _ball, skin = physics.build(case, "cpu")
    assert sim.step_count == 3 and abs(reading_array(skin).numpy()).max() > 0
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


def test_figures_of_genesis_are_of_its_own_scene():
    for case in (*physics.all_cases("cpu"), *physics.all_cases("cuda:0")):
        assert case.genesis_us is None or case.scene == "genesis", case.title
    case = next(case for case in physics.all_cases("cpu") if case.scene == "genesis")
    sim, _ball, skin = physics.build(replace(case, n_envs=2, side=16), "cpu", threads=1)
    assert (reading_array(skin).numpy() > 0).mean() > 0.85  # nearly every taxel touches
    assert "Genesis's scene" in case.title and sim.plan.threads == 1


def test_poses_differ_and_move():
    case = physics.Case(sensor="ContactDepthProbe", side=8, n_envs=4, spread_mm=1)
    sim, ball, skin = physics.build(case, "cpu")
    move, seen = physics.Mover(case, sim, ball), []
    for _ in range(3):
        move()
        sim.step()
        seen.append(skin.read())
    assert len({env.tobytes() for step in seen for env in step}) == 12
    assert physics.measure(case, repeats=5).step_us > 0


def test_loops_are_measured_and_make_a_page(monkeypatch):
    monkeypatch.setattr(physics_loops, "SECONDS", 0.01)
    lines = []
    for only in ("loop around KinematicTaxel, 256", "hand"):
        figures = physics_loops.run(lines.append, only=only, n_envs=2)
        assert len(figures) >= 6 and len(lines) >= 6
        assert all(figure["us"] > 0 for figure in figures.values())
        (first, *_others) = figures
        assert first.endswith("2 envs: step") and figures[first]["steps"] == 1.0
    page = physics.markdown_page(figures, "cpu")
    assert page.count("| loop around a hand") == len(figures)


def test_a_start_is_measured_in_a_process_of_its_own():
    assert 0 < physics.first_reading_s("ContactProbe", str(wp.config.kernel_cache_dir), "cpu") < 120
