"""What people use: save, restore and fork of what `serve` returns, from the command line."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import StateError, TactemuError
from tests.cli.command import here
from tests.emulator.test_sources import ENGINE, MODEL


def felt(dev: tt.Served) -> np.ndarray:
    sample = dev.sample()
    assert sample is not None
    return sample.measured


def test_a_press_is_gone_back_to_and_forked_a_dozen_times(tmp_path):
    """In lockstep, where nothing depends on the machine."""
    with tt.serve("anyskin", port="memory:", clock="lockstep", seed=2) as dev:
        dev.press(depth=1e-3)
        dev.step(seconds=0.8)
        size = dev.save(tmp_path / "pressed.npz")
        assert size == (tmp_path / "pressed.npz").stat().st_size
        pressed = felt(dev)
        forks = [dev.fork("memory:") for _ in range(12)]

        def lifted(of) -> np.ndarray:
            of.release()
            of.step(seconds=0.5)
            return felt(of)

        freed = lifted(dev)
        assert abs(freed).max() < abs(pressed).max() / 10
        for each in forks:
            with each as other:
                np.testing.assert_array_equal(felt(other), pressed)
                np.testing.assert_array_equal(lifted(other), freed)
        np.testing.assert_array_equal(felt(dev), freed, "they are others")
        dev.restore(tmp_path / "pressed.npz")
        np.testing.assert_array_equal(felt(dev), pressed)
        np.testing.assert_array_equal(lifted(dev), freed)
        with pytest.raises(StateError, match="No such file"):
            dev.restore(tmp_path / "other.npz")
    with (
        tt.serve("anyskin", port="memory:", clock="lockstep", seed=3) as other,
        pytest.raises(StateError, match=r"asked for\.seed: saved with 2, here 3"),
    ):
        other.restore(tmp_path / "pressed.npz")


def test_a_state_of_a_terminal_is_gone_on_from_in_another(tmp_path):
    state, first, second = (str(tmp_path / name) for name in ("state.npz", "first.jsonl", "second.jsonl"))
    virtual = ["--port", "memory:", "--clock", "virtual", "--plain"]
    run = ["run", "anyskin", *virtual, "--seconds", "0.5", "--save", state, "--save-at", "0.3013", "--truth", first]
    assert here(*run).returncode == 0
    goes_on = here("run", "anyskin", *virtual, "--seconds", "0.1987", "--restore", state, "--truth", second)
    assert goes_on.returncode == 0, goes_on.stderr
    whole, rest = tt.read_log(first)["anyskin"], tt.read_log(second)["anyskin"]
    later = whole.t_ns > 301_300_000
    np.testing.assert_array_equal(rest.t_ns, whole.t_ns[later])
    np.testing.assert_array_equal(rest.counts, whole.counts[later])
    refused = here("run", "anyskin", *virtual, "--seconds", "1", "--rate", "50", "--restore", state)
    assert refused.returncode == 2 and "asked for.rate_hz: saved with None, here 50.0" in refused.stderr
    assert "add --save FILE" in here("run", "anyskin", *virtual, "--seconds", "1", "--save-at", "1").stderr


def test_a_source_of_ones_own_is_asked_by_the_fork_too():
    def readings(t_s: float) -> np.ndarray:
        return np.full((5, 3), t_s)

    with tt.serve("anyskin", port="memory:", clock="lockstep", source=readings) as dev:
        dev.step(seconds=0.3)
        with dev.fork("memory:") as other:
            for each in (dev, other):
                each.step(seconds=0.2)
            np.testing.assert_array_equal(felt(other), felt(dev))
            assert felt(other).max() == pytest.approx(0.5, abs=0.01)


def test_a_simulation_of_ones_own_is_forked_with_handles_of_its_own():
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.03, 0.03, 0.01)), fixed=True)
    motion = tt.Press(approach=0.002, depth=0.001, speed=0.02)
    scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.017), motion=motion)
    skin = scene.add_sensor(
        tt.KinematicTaxel(
            positions=[(0.002 * x, 0.002 * y, 0.005) for x, y in ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1))],
            radius=0.002,
            imperfections=tt.ImperfectionOptions(hysteresis_strength=0.3),
        ),
        link=pad,
    )  # fmt: skip
    with tt.serve("anyskin", port="memory:", clock="lockstep", source=scene) as dev:
        dev.step(seconds=0.13)
        with dev.fork("memory:") as other:
            other.step(seconds=0.2)
            before = skin.read().force.copy()
            dev.step(seconds=0.2)
            np.testing.assert_array_equal(felt(other), felt(dev))
            assert abs(before - skin.read().force).max() > 0, "the handle stayed with the first"


def test_a_mujoco_model_goes_on_amid_its_fall(tmp_path):
    pytest.importorskip("mujoco", reason="pip install 'tactemu[mujoco]'")
    (tmp_path / "ball.xml").write_text(MODEL)
    (tmp_path / "scene.toml").write_text(ENGINE.format(link="pad"))
    with tt.serve(tmp_path / "scene.toml", port="memory:", clock="lockstep") as dev:
        dev.step(seconds=0.03)
        dev.save(tmp_path / "falling.npz")
        with dev.fork("memory:") as other:
            for each in (dev, other):
                each.step(seconds=0.4)
            landed = felt(dev)
            assert abs(landed).max() > 0.1
            np.testing.assert_array_equal(felt(other), landed)
        dev.restore(tmp_path / "falling.npz")
        dev.step(seconds=0.4)
        np.testing.assert_array_equal(felt(dev), landed)


def test_what_cannot_be_saved_is_refused_with_its_place(tmp_path):
    with tt.serve("anyskin", port="memory:", clock="lockstep") as dev:
        vars(dev.device())["hook"] = lambda: None
        with pytest.raises(TactemuError, match=r"cannot be saved: self\.hook is a builtins\.function"):
            dev.save(tmp_path / "state.npz")
        assert not list(tmp_path.iterdir())
