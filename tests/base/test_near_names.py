"""Messages about unknown names: each has the nearest known name, and all of them."""

from typing import Literal

import pytest

import tactemu as tt
from tactemu.base.errors import DeviceError, SceneError, TactemuError, no_such
from tactemu.base.options import choice
from tactemu.cli.attaching import attach
from tactemu.control.messages import watch_options
from tactemu.geometry.bodies import find_body
from tactemu.geometry.shapes.registry import REGISTRY, SHAPES, SYNONYMS
from tactemu.transports.usb import vhci
from tactemu.truth import Truth, read_log


def test_the_message():
    assert no_such("skin", "tumb", ["thumb", "palm"]) == "no skin 'tumb'; did you mean 'thumb'? (skins: thumb, palm)"
    assert no_such("body", "x", [], "bodies") == "no body 'x' (bodies: none)"


def two_bodies():
    scene = tt.Scene()
    scene.add_body(tt.Sphere(radius=0.01), name="thumb")
    scene.add_body(tt.Sphere(radius=0.01), name="index")
    return scene


def test_a_body():
    bodies = two_bodies().bodies
    with pytest.raises(SceneError, match=r"no body 'tumb'; did you mean 'thumb'\? \(bodies: thumb, index\)"):
        find_body(bodies, "tumb")
    with pytest.raises(SceneError, match=r"no body 7 \(bodies: 0: thumb, 1: index\)"):
        find_body(bodies, 7)


def test_live_commands():
    with tt.serve("anyskin", "memory:", clock="lockstep") as dev:
        for command, near in (
            (lambda: dev.sample("anyskn"), r"no skin 'anyskn'; did you mean 'anyskin'\?"),
            (lambda: dev.move((0, 0, 0.1), body="bal"), r"no steered body 'bal'; did you mean 'ball'\?"),
        ):
            with pytest.raises(TactemuError, match=near):
                command()
        dev.fault("drop 1%")
        with pytest.raises(SceneError, match=r"no fault 'drip' \(those that are on: drop 1%"):
            dev.mend("drip")


def test_options_of_a_run():
    with pytest.raises(TypeError, match=r"'rate'; did you mean 'rate_hz'\?"):
        tt.serve("anyskin", rate=3)
    with pytest.raises(SceneError, match=r"got 'pace'; did you mean 'paced'\?"):
        tt.serve("anyskin", clock="pace")
    with pytest.raises(TactemuError, match=r"watch: no argument 'rat'; did you mean 'rate'\?"):
        watch_options({"rat": 3})
    with (
        pytest.raises(DeviceError, match=r"no port 'anyskn'; did you mean 'anyskin'\?"),
        tt.serve("anyskin", {"anyskn": "memory:"}),
    ):
        pass


def test_a_choice():
    with pytest.raises(SceneError, match=r"got 'wled'; did you mean 'weld'\?"):
        choice("contact", "kind", "wled", Literal["weld", "slide"])


def test_a_device_of_a_usbip_server(monkeypatch):
    monkeypatch.setattr(vhci, "listed", lambda host, port: [vhci.RemoteDevice("1-1", 1, 2)])
    with pytest.raises(TactemuError, match=r"127\.0\.0\.1 has no device '1-11'; did you mean '1-1'\? \(devices: 1-1\)"):
        attach("127.0.0.1", ["1-11"])


def test_a_skin_of_a_log(tmp_path):
    log = Truth(tmp_path / "t.mcap")
    log.wrote(0, "thumb", b"?")
    log.close()
    with pytest.raises(KeyError, match=r"no skin 'tumb'; did you mean 'thumb'\?"):
        read_log(tmp_path / "t.mcap")["tumb"]


@pytest.mark.parametrize("word", SYNONYMS)
def test_a_synonym_of_a_shape_is_translated(word):
    assert word not in SHAPES and f"unknown shape {word!r}; did you mean {SYNONYMS[word]!r}?" in REGISTRY.unknown(word)
