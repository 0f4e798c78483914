"""A file that anybody may have written: refused in words, in bounded time and memory, and nothing has changed."""

import io
import json
import random
import tracemalloc
import zipfile

import numpy as np
import pytest

import tactemu
from tactemu.base.errors import StateError, TactemuError
from tests.emulator.saving import story
from tests.fuzz import TIMES


@pytest.fixture(scope="module")
def data():
    return story.of_device("paxini_px6ax")


@pytest.fixture(scope="module")
def saved(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("state") / "whole.npz"
    emulator = story.build(data)
    story.ask(emulator)
    with emulator:
        emulator.run(0.1313)
        assert emulator.save(path) == path.stat().st_size
    return path.read_bytes()


@pytest.fixture(scope="module")
def emulator(data):
    """One that runs, from 0.02 s on, and is not to be changed."""
    emulator = story.build(data)
    with emulator:
        emulator.run(0.02)
        yield emulator


def members(saved: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(saved), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def packed(members: dict, save=np.savez) -> bytes:
    file = io.BytesIO()
    save(file, **members)
    return file.getvalue()


def text(value) -> np.ndarray:
    return np.frombuffer(json.dumps(value).encode(), np.uint8)


def header(saved: bytes) -> dict:
    return json.loads(members(saved)["header"].tobytes())


def refused(emulator, path, content: bytes) -> str:
    """Why; and nothing has changed."""
    path.write_bytes(content)
    before = repr(emulator.snapshot())
    with pytest.raises(StateError) as info:
        emulator.restore(path)
    assert repr(emulator.snapshot()) == before
    assert len(str(info.value)) < 600
    return str(info.value)


def test_what_is_no_state(emulator, tmp_path, saved):
    path = tmp_path / "x.npz"
    with pytest.raises(StateError, match="No such file"):
        emulator.restore(path)
    with pytest.raises(StateError, match="is no file"):
        emulator.restore("/dev/zero")
    for content in (b"", b"PK", b"\x80\x04.", saved[: len(saved) // 2], saved[100:]):
        assert "no state, or a damaged one" in refused(emulator, path, content)
    assert "header" in refused(emulator, path, packed({"a": np.zeros(3)}))


def test_of_another_version_or_scene(emulator, tmp_path, saved):
    path, parts, head = tmp_path / "x.npz", members(saved), header(saved)
    older = packed(parts | {"header": text(head | {"tactemu": "0.0.9"})})
    assert f"was saved by tactemu 0.0.9 (format 1), this is {tactemu.__version__}" in refused(emulator, path, older)
    newer = packed(parts | {"header": text(head | {"format": 7})})
    assert "(format 7)" in refused(emulator, path, newer)
    for name, value, words in [
        ("skin[0].rate_hz", "77", "skin[0].rate_hz: saved with 77, here None"),
        ("device.paxini_px6ax.option.model", "'x'", "device.paxini_px6ax.option.model: saved with 'x', here nothing"),
        ("asked for.seed", "4", "asked for.seed: saved with 4, here 3"),
        ("simulation.dt", "0.001", "simulation.dt: saved with 0.001, here 0.005"),
    ]:
        other = packed(parts | {"header": text(head | {"made_of": head["made_of"] | {name: value}})})
        assert words in refused(emulator, path, other)


def test_members_that_are_not_what_they_say(emulator, tmp_path, saved):
    path, parts = tmp_path / "x.npz", members(saved)
    assert "is compressed" in refused(emulator, path, packed(parts, np.savez_compressed)), "a bomb may be in it"
    objects = packed(parts | {"a0": np.array([{}, 1], object)})
    assert "states have numbers" in refused(emulator, path, objects)
    huge = io.BytesIO()
    np.lib.format.write_array_header_1_0(huge, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)})
    file = io.BytesIO(packed({name: each for name, each in parts.items() if name != "a0"}))
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("a0.npy", huge.getvalue() + b"\0" * 8)
    tracemalloc.start()
    assert "has other than 8 bytes" in refused(emulator, path, file.getvalue())
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    without = {name: each for name, each in parts.items() if name != "a3"}
    assert "a3" in refused(emulator, path, packed(without))
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(StateError, match="a state of this run has at most"):
        emulator.restore(path)


def test_a_tree_that_is_not_ours(emulator, tmp_path, saved):
    path, parts = tmp_path / "x.npz", members(saved)
    tree = json.loads(parts["tree"].tobytes())

    def told(change) -> str:
        other = json.loads(json.dumps(tree))
        change(dict(other["dict"]))
        return refused(emulator, path, packed(parts | {"tree": text(other)}))

    def of(part: dict, name: str) -> list:
        return next(pair for pair in part["dict"] if pair[0] == name)

    device = "channels[0].device"
    assert "the state lacks the attribute 'samples'" in told(
        lambda t: t["channels[0]"]["dict"].remove(of(t["channels[0]"], "samples"))
    )
    assert "samples: expected int, got str" in told(lambda t: of(t["channels[0]"], "samples").__setitem__(1, "x"))
    assert f"{device}: the state of paxini_px6ax lacks" in told(lambda t: t[device]["dict"].clear())
    named = {"dict": [["~", "named"], ["as", "firmware_protocols.check.other_process:subprocess.run"]]}
    assert "a state cannot hold" in told(lambda t: t[device]["dict"].append(["measure", named])), (
        "what a module imports"
    )
    named = {"dict": [["~", "object"], ["n", 1], ["class", "os:PathLike"], ["state", {"dict": []}]]}
    assert "a state cannot hold os:PathLike" in told(lambda t: t[device]["dict"].append(["x", named]))
    again = {"dict": [["~", "array"], ["n", 10**6], ["value", {"array": "a0"}]]}
    assert "a0" in told(lambda t: t[device]["dict"].append(["x", again])), "an array is there once"
    plan = {"dict": [["~", "list"], ["n", 10**6], ["items", [[0, 1, "rm"]]]]}
    assert "entries[0]: expected tuple, got list" in told(lambda t: of(t["_agenda"], "entries").__setitem__(1, plan))
    deep = b'{"dict": [["", ' + b"[" * 100_000 + b"]" * 100_000 + b"]]}"
    assert "not the text" in refused(emulator, path, packed(parts | {"tree": np.frombuffer(deep, np.uint8)}))


def test_what_is_damaged_at_random_is_refused_or_runs(data, emulator, tmp_path, saved):
    """Bytes anywhere; then numbers, texts and structure of the tree, in a file that is whole."""
    path, chance, parts = tmp_path / "x.npz", random.Random(1), members(saved)
    refusals = 0
    for _ in range(40 * TIMES):
        content = bytearray(saved)
        for _ in range(chance.randint(1, 4)):
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        path.write_bytes(content)
        refusals += _restored(emulator, path)
    assert refusals > 30 * TIMES
    tree = parts["tree"].tobytes()
    for _ in range(40 * TIMES):
        start = chance.randrange(len(tree))
        junk = chance.choice([b"null", b"-1", b'"x"', b"[]", b"{}", b"1e400", b"9" * 30, b"", b"true", b'{"dict": []}'])
        other = tree[:start] + junk + tree[start + chance.randint(0, 12) :]
        path.write_bytes(packed(parts | {"tree": np.frombuffer(other, np.uint8)}))
        refusals += _restored(emulator, path)
    assert refusals > 60 * TIMES


def _restored(emulator, path) -> bool:
    """Whether it was refused; what is accepted runs, or ends in an error of ours."""
    try:
        emulator.restore(path)
    except StateError:
        return True
    try:
        emulator.run(0.02)
    except (TactemuError, TypeError, ValueError, AttributeError, LookupError, ArithmeticError):
        pass
    return False


def test_a_file_that_cannot_be_written_leaves_the_old_one(emulator, tmp_path, monkeypatch):
    path = tmp_path / "state.npz"
    emulator.save(path)
    old = path.read_bytes()
    with pytest.raises(StateError, match="cannot write the state"):
        emulator.save(tmp_path / "nowhere" / "state.npz")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(StateError, match="No space left"):
        emulator.save(path)
    assert path.read_bytes() == old and list(tmp_path.iterdir()) == [path]
