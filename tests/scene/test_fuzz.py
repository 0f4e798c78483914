"""Whatever a scene file says: a scene, or an error of ours that names the file."""

import copy

from hypothesis import given
from hypothesis import strategies as st

from tactemu.base.errors import TactemuError
from tactemu.scene import file
from tactemu.scene.building import build_scene, make_devices
from tests.fuzz import examples

SCENE = {
    "scene": {"dt": 0.001, "seed": 1, "device": "cpu", "dtype": "float32"},
    "body": [
        {"name": "pad", "shape": "box", "size": [0.1, 0.1, 0.02], "fixed": True},
        {
            "name": "ball", "shape": "sphere", "radius": 0.01, "position": [0, 0, 0.02], "quaternion": [1, 0, 0, 0],
            "motion": {"kind": "press", "depth": 0.001, "approach": 0.002, "speed": 0.01, "direction": [0, 0, -1]},
        },
        {
            "name": "rod", "shape": "capsule", "radius": 0.01, "length": 0.02,
            "motion": [
                {"kind": "keyframes", "times": [0, 1], "positions": [[0, 0, 0], [0, 0, 1]]},
                {"kind": "together", "motions": [{"kind": "spin", "rate": 1.0, "angle": 3.0}, {"kind": "hold"}]},
            ],
        },
    ],
    "skin": [
        {
            "name": "tip", "device": "linker_hand_o6", "device_options": {"side": "left"}, "link": "pad",
            "position": [0, 0, 0.01], "quaternion": [1, 0, 0, 0], "model": "kinematic_taxel", "embed": 0.001,
            "options": {"normal_stiffness": 400.0, "noise": 0.1, "radius": 0.001}, "port": "memory:",
            "rate_hz": 100.0, "clock": {"delay_s": 0.001, "jitter_s": 0.0, "skew_ppm": 1.0}, "faults": ["drop 1%"],
        },
    ],
    "scenario": [{"at": 1.0, "until": 2.0, "skin": "tip", "dead": [1], "set": {"noise": 0.1}, "fault": "drop 1%"}],
}  # fmt: skip

junk = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.just([]), st.just({}),
    st.lists(st.floats(), max_size=5), st.sampled_from(["pad", "ball", "sphere", "press", "memory:", "..", "a.py:B"]),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2), st.just([[]]), st.just(10**400),
)  # fmt: skip


def places(value, path=()):
    """Every place in the tables."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*path, key))


PLACES = [path for path in places(SCENE) if path]


@examples(200)
@given(st.lists(st.tuples(st.sampled_from(PLACES), st.sampled_from(["replace", "drop", "rename"]), junk), max_size=3))
def test_a_spoiled_scene_is_a_scene_or_an_error_of_ours(changes):
    data = copy.deepcopy(SCENE)
    for path, what, value in changes:
        try:
            spoil(data, path, what, value)
        except (KeyError, IndexError, TypeError, AttributeError):
            continue  # an earlier change has taken the place away
    try:
        loaded = file.check(data, source="x.toml")
        build_scene(loaded, make_devices(loaded))
    except TactemuError as error:
        assert str(error)


def spoil(data, path, what, value) -> None:
    for key in path[:-1]:
        data = data[key]
    if what == "replace":
        data[path[-1]] = value
    elif what == "drop":
        del data[path[-1]]
    else:
        data[f"{path[-1]}x"] = data.pop(path[-1])
