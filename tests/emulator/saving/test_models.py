"""Every sensor model and imperfection: a run that goes on from a saved state feels what the uninterrupted one does."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import StateError
from tactemu.sensors.models import MODELS, model_class
from tests.emulator.saving import story

FEELS = f"{story.__file__.removesuffix('story.py')}feels.py:Feels"
SAVED_S, SECONDS = 0.0803, 0.15
PLAIN = [(name, words, {}) for name in MODELS for words in model_class(name).examples]
SPOILT = {
    "memory": {
        "hysteresis_strength": 0.2, "hysteresis_strength_unloading": 0.1, "hysteresis_backlash": 1e-3,
        "creep_strength": 0.3, "creep_tau": 0.1, "crosstalk_strength": 0.1, "crosstalk_sigma": 0.003,
        "scan_time": 0.004,
    },
    "electronics": {
        "gain_range": (0.8, 1.2), "radius_noise": 1e-4, "random_walk": 1e-3, "bias": 0.1,
        "noise_density": 1e-3, "temperature_course": [(0.0, 20.0), (0.1, 40.0)], "temperature_offset": 0.01,
        "resolution": 1e-3, "dead_taxel_probability": 0.1, "saturation_range": (-5.0, 5.0), "delay": 0.007,
        "jitter": 0.01, "delay_interpolation": "linear", "adjustable": ["noise", "dead"],
    },
}  # fmt: skip


def scene(model: str, options: dict) -> dict:
    """A ball pressed in and dragged over the pad, from before the touch to after the state is saved."""
    offers = model_class(model).layouts
    quantity = "force" if "force" in offers else next(iter(offers))  # friction does not show in the pressure
    motion = {"kind": "together", "motions": [
        {"kind": "press", "approach": 0.001, "depth": 0.001, "speed": 0.04, "dwell": 0.02},
        {"kind": "slide", "distance": 0.003, "delay": 0.06, "speed": 0.05},
    ]}  # fmt: skip
    skin = {"device": FEELS, "device_options": {"quantity": quantity}, "position": [0, 0, 0.005], "link": "pad"}
    changes = [{"at": 0.05, "dead": [9]}, {"at": 0.06, "set": {"noise": 0.01}}]
    return {
        "scene": {"dt": 0.002},
        "body": [
            {"name": "pad", "shape": "box", "size": [0.03, 0.03, 0.01], "fixed": True, "position": [0, 0, -0.005]},
            {"name": "ball", "shape": "sphere", "radius": 0.01, "position": [0, 0, 0.011], "motion": motion},
        ],
        "skin": [skin | {"model": model, "options": options}],
        "scenario": changes if "adjustable" in options else [],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("model", "words", "spoilt"),
    [*PLAIN, *(("kinematic_taxel", "", options) for options in SPOILT.values())],
    ids=[*(f"{name}{words}" for name, words, _ in PLAIN), *SPOILT],
)
def test_goes_on_as_if_never_interrupted(model, words, spoilt):
    data = scene(model, {**model_class(model).examples.get(words, {}), **spoilt})
    whole, states = story.build(data), []
    with whole:
        whole.call(
            lambda: states.append((whole.snapshot(), len(whole.truth.frames), len(whole.truth.samples))), 80_300_000
        )
        whole.run(SECONDS)
    frames, samples = story.heard(whole)
    ((state, n_frames, n_samples),) = states
    assert len({sample[4] for sample in samples}) > 4, "it feels something that changes"
    other = story.build(data)
    for _ in range(2):  # in a fresh emulator, then in one whose ball has come and gone
        other.restore(state)
        with other:
            other.run(SECONDS - SAVED_S)
        assert story.heard(other) == [frames[n_frames:], samples[n_samples:]]
        assert story.counted(other) == story.counted(whole)


def test_of_a_model_of_ones_own_all_that_its_context_made_is_saved():
    """Batched, without an emulator, and in both widths: environments go on each from its own state."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.03, 0.03, 0.01)), fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.01))
    skin = scene.add_sensor(
        tt.KinematicTaxel(
            radius=0.002,
            imperfections=tt.ImperfectionOptions(hysteresis_strength=0.3),
            electronics=tt.ElectronicsOptions(random_walk=1e-3, history_length=3),
        ),
        link=pad,
    )
    sim = scene.build(n_envs=3, seed=5, dtype="float64")
    down = np.array([[0.0, 0.0, 0.0145], [0.0, 0.0, 0.0148], [0.0, 0.0, 0.02]])

    def go(steps: int) -> bytes:
        for k in range(steps):
            sim.set_pose(ball, position=down - 1e-5 * (sim.step_count + k))
            sim.step()
        return b"".join(part.tobytes() for part in skin.read())

    go(7)
    state = sim.state()
    first = go(9)
    sim.reset()
    go(3)
    sim.prepare_restore(state)()
    assert go(9) == first
    with pytest.raises(ValueError, match=r"expected .* arrays, got 1"):
        sim.prepare_restore(state | {"memory": state["memory"][:1]})
    with pytest.raises(ValueError, match=r"array 0: expected \(1,\) float64, got \(2,\) float64"):
        sim.prepare_restore(state | {"memory": [np.zeros(2), *state["memory"][1:]]})
    with pytest.raises(ValueError, match="array 0: expected finite numbers, got nan"):
        sim.prepare_restore(state | {"memory": [np.full(1, np.nan), *state["memory"][1:]]})


def test_a_state_of_another_scene_is_refused_in_words(tmp_path):
    here = story.build(scene("kinematic_taxel", {"radius": 0.002}))
    with here:
        here.run(0.02)
        here.save(tmp_path / "state.npz")
    other = story.build(scene("kinematic_taxel", {"radius": 0.003}))
    with other, pytest.raises(StateError, match=r"skin\[0\]\.options\.radius: saved with 0\.002, here 0\.003"):
        other.restore(tmp_path / "state.npz")
