"""One value of a scene replaced: one sentence, or a run whose readings and counts hold. The nightly run tries all."""

import random
import signal
import tomllib

import pytest

from tests.scene import altered
from tests.scene.altered import VALUES, cases, trial

SCENES = ["contact_probe", "depth_probe", "kinematic", "kinematic_ray", "magnets", "piezo", "proximity", "two_skins"]
"""Scenes that are built in some hundredths of a second."""
ONCE_WRONG = [
    ("contact_probe", "body.1.quaternion.0", "1e308"),
    ("contact_probe", "skin.0.quaternion", "[]"),
    ("depth_probe", "scenario.0.set.resolution", "-1"),
    ("elastomer", "skin.0.options.n_sample_points", "text"),
    ("elastomer", "skin.0.options.area_weighted", "text"),
    ("kinematic", "skin.0.clock.jitter_s", "-1"),
    ("kinematic", "skin.0.options.noise", "1e308"),
    ("kinematic", "skin.0.options.crosstalk_sigma", "1e12"),
    ("kinematic", "skin.0.options.crosstalk_conserving", "[]"),
    ("kinematic", "scenario.0.set.noise", "[]"),
    ("kinematic_ray", "skin.0.options.crosstalk_kernel.0", "0"),
    ("kinematic_ray", "skin.0.options.scan_order.1", "[]"),
    ("kinematic_ray", "skin.0.options.radius", "1e308"),
    ("layer", "skin.0.options.oversampling", "1e308"),
    ("magnetic", "skin.0.transducer.0.kind", "[]"),
    ("magnetic", "skin.0.transducer.0.last", "1e308"),
    ("magnetic", "skin.0.transducer.1.moments.0", "[]"),
    ("magnets", "skin.0.transducer", "[]"),
    ("magnets", "skin.0.transducer.0.magnets", "[]"),
    ("mujoco", "skin.0.device_options.swing", "1e308"),
    ("piezo", "skin.0.transducer.0.temperature_reference", "1e12"),
    ("two_skins", "body.2.motion.pivot.0", "1e308"),
    ("two_skins", "body.2.motion.zero", "1e308"),
]
"""Values that once raised something else than a sentence, or gave readings that are not finite."""


@pytest.fixture(autouse=True)
def _signals():
    before = {number: signal.getsignal(number) for number in (signal.SIGALRM, signal.SIGPROF)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_runs_as_it_is(scene):
    assert altered.tried(altered.SCENES[scene], tomllib.loads(altered.SCENES[scene].read_text())) == ""


@pytest.mark.parametrize(("scene", "way", "value"), ONCE_WRONG, ids=lambda part: str(part).replace("skin.0.", ""))
def test_what_was_once_wrong_is_one_sentence(scene, way, value):
    assert trial(scene, tuple(int(key) if key.isdigit() else key for key in way.split(".")), value)


def test_altered_values_are_refused_or_harmless():
    """A sample of those that ``python -m tests.scene.altered`` tries, always the same."""
    chosen = random.Random(28).sample(list(cases(SCENES, list(VALUES))), 120)
    assert sum(bool(trial(*case)) for case in chosen) > 60
