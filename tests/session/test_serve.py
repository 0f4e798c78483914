"""A device served to a test: moved by hand from another thread, read by a plain serial port."""

import threading
import time

import numpy as np
import pytest
import serial

from tactemu.base.errors import SceneError, TactemuError, TransportError
from tactemu.geometry.motion import Press
from tactemu.session.serving import serve

FRAME = 82


def fields(frames: bytes) -> np.ndarray:
    """Bz of the five chips in each whole frame."""
    whole = [frames[k : k + FRAME] for k in range(0, len(frames) - FRAME + 1, FRAME)]
    return np.array([np.frombuffer(f[:80], "<f4").reshape(5, 4)[:, 3] for f in whole])


@pytest.fixture(scope="module")
def dev():
    with serve("anyskin", rate_hz=200) as device:
        yield device


def test_a_press_is_felt_and_released(dev):
    with serial.Serial(dev.port, 115200, timeout=2) as port:
        dev.press(1e-3, taxel=2)
        at_depth = dev.sample().ideal
        port.reset_input_buffer()
        pressed = fields(port.read(4 * FRAME))
        dev.release()
        dev.wait(0.05)
        port.reset_input_buffer()
        free = fields(port.read(4 * FRAME))
    np.testing.assert_allclose(at_depth[2], (0, 0, -1.0), atol=1e-4)  # 1000 N/m x 1 mm, on the skin
    assert np.argmax(np.abs(pressed[-1] - free[-1])) == 2
    assert not dev.sample().ideal.any()


def test_a_press_takes_a_body_that_a_program_has_posed(dev):
    body = next(body for body in dev.simulation.bodies if body.motion is not None)
    dev.in_loop(lambda: dev.simulation.set_pose(body, position=(0, 0, 0.5)))
    dev.press(1e-3, taxel=2)
    np.testing.assert_allclose(dev.sample().ideal[2], (0, 0, -1.0), atol=1e-4)
    dev.release()


def test_a_press_that_is_done_has_been_sampled_also_by_a_loop_that_is_late(dev):
    busy = True

    def stall():
        time.sleep(0.02)  # four periods
        if busy:
            dev.emulator.at(dev.emulator.clock.now_ns(), stall)

    dev.emulator.call(stall)
    try:
        for _ in range(5):
            dev.press(1e-3, taxel=2)
            np.testing.assert_allclose(dev.sample().ideal[2], (0, 0, -1.0), atol=1e-4)
            dev.release()
            assert not dev.sample().ideal.any()
    finally:
        busy = False


def test_press_for_a_time_returns_released(dev):
    dev.press(1e-3, dwell=0.1, taxel=0)
    assert not dev.sample().ideal.any()
    with serve("anyskin", "memory:", rate_hz=200, clock="lockstep") as held:  # no stall leaves samples out
        held.press(1e-3, dwell=0.1, taxel=0)
        held.step(seconds=1)
        felt = [sample.t_ns for sample in held.truth.samples if sample.ideal[0].any()]
    assert felt[-1] - felt[0] == pytest.approx(0.1e9 + 2 * 1e-3 / Press.speed * 1e9, abs=2 / 200 * 1e9)


def test_move_puts_the_body_where_it_is_told(dev):
    dev.move(position=(0.007, 0.0, 0.003 + 0.02 - 0.0005), seconds=0.05)
    dev.wait(0.02)
    np.testing.assert_allclose(dev.sample().ideal[2], (0, 0, -0.5), atol=1e-4)
    dev.move(by=(0, 0, 0.01))
    dev.wait(0.02)
    assert not dev.sample().ideal.any()


def test_calls_from_many_threads(dev):
    threads = [threading.Thread(target=dev.press, args=(1e-3,), kwargs={"dwell": 0.01, "taxel": k}) for k in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()


def test_mistakes_are_raised_where_they_are_made(dev):
    with pytest.raises(TactemuError, match=r"taxel: expected 0\.\.4, got 9"):
        dev.press(1e-3, taxel=9)
    with pytest.raises(TactemuError, match=r"no steered body 'bal'; did you mean 'ball'\? \(steered bodies: ball\)"):
        dev.press(1e-3, body="bal")


def test_nothing_is_left(tmp_path):
    path = tmp_path / "port"
    before = threading.active_count()
    with serve("anyskin", f"pty:{path}") as device:
        assert device.port == str(path)
        assert path.is_symlink()
    assert not path.is_symlink()
    assert threading.active_count() == before
    device.stop()


@pytest.mark.parametrize(("port", "scheme"), [("tcp:0", "socket"), ("rfc2217:0", "rfc2217")])
def test_the_port_is_what_a_driver_opens(port, scheme):
    with serve("anyskin", port) as device:
        assert device.port == f"{scheme}://{device.host_port[0]}:{device.host_port[1]}"
        with serial.serial_for_url(device.port, 115_200, timeout=2) as driver:
            assert len(driver.read(FRAME)) == FRAME


def test_a_path_has_no_host(dev):
    with pytest.raises(TactemuError, match=r"no host and port.*tcp:0"):
        _ = dev.host_port


def test_a_port_is_a_can_bus_or_has_a_host_if_its_connector_has():
    with serve("anyskin", "memory:") as device:
        with pytest.raises(TactemuError, match=r"no CAN bus; the device has a serial connector: open dev\.port"):
            _ = device.can
    with serve("xela_uskin", "can:virtual:hosts") as device:
        assert device.can == {"interface": "virtual", "channel": "hosts"}
        with pytest.raises(TactemuError, match=r"the device has a can connector: open can.Bus\(\*\*dev.can\)"):
            _ = device.host_port
    with serve("xela_uskin", "memory:") as device:
        with pytest.raises(TactemuError, match=r"no CAN bus; give serve.*port='can:virtual:NAME'"):
            _ = device.can


def test_a_port_that_cannot_be_made_leaves_nothing():
    before = threading.active_count()
    with pytest.raises(TransportError):
        serve("anyskin", "pty:/nonexistent/port").start()
    assert threading.active_count() == before


def test_an_error_in_the_background_reaches_the_test():
    def fail():
        raise TactemuError("the mesh is gone")

    device = serve("anyskin", "memory:").start()
    device.emulator.call(fail)
    with pytest.raises(TactemuError, match="the mesh is gone"):
        device.wait(1.0)
    device.stop()


@pytest.mark.parametrize(
    ("slip", "says"),
    [
        (lambda dev: dev.press(depth=1), r"press: depth must be >= -0.5 and <= 0.5 m \(6 mm is 0.006\), got 1"),
        (lambda dev: dev.press(depth=True), "press: depth must be"),
        (lambda dev: dev.press("1mm"), "press: depth must be"),
        (lambda dev: dev.press(1e-3, dwell=-1), "press: dwell must be >= 0"),
        (lambda dev: dev.press(1e-3, speed=0), "press: speed must be"),
        (lambda dev: dev.press(1e-3, taxel=77), "taxel: expected 0..4, got 77"),
        (lambda dev: dev.release(speed=-1), "release: speed must be"),
        (lambda dev: dev.move(position=(0, 0, float("nan"))), "move: position must be finite"),
        (lambda dev: dev.move(by=(1, 2)), "move: by must be 3 numbers"),
        (lambda dev: dev.move(quaternion=(1, 0, 0)), "move: quaternion must be 4 numbers"),
        (lambda dev: dev.wait(float("inf")), "wait: seconds must be"),
        (lambda dev: dev.inject_event(set={"noise": "loud"}), "noise must be numbers"),
        (lambda dev: dev.inject_event(set={"jitter": 1e9}), "built without jitter"),
    ],
)
def test_a_slip_of_the_tests_is_refused_in_words_and_harms_nothing(memory_dev, slip, says):
    with pytest.raises(TactemuError, match=says):
        slip(memory_dev)
    memory_dev.wait(0.02)


@pytest.fixture(scope="module")
def memory_dev():
    with serve("anyskin", "memory:", adjustable="noise") as device:
        yield device


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"port": 3}, "port: give a text such as 'pty:/tmp/skin', got 3"),
        ({"rate_hz": "fast"}, "rate must be a number >= 0.001 and <= 1e\\+06 Hz, got the text 'fast'"),
        ({"rate_hz": 0}, "rate must be"),
        ({"seed": "x"}, "seed: expected a whole number, got 'x'"),
        ({"faults": [3]}, "faults: expected a list of texts"),
        ({"steer": "bal"}, "steer: there is no movable body 'bal'; did you mean 'ball'"),
    ],
)
def test_a_wrong_request_is_refused_in_words(wrong, says):
    with pytest.raises(TactemuError, match=says):
        serve("anyskin", **{"port": "memory:"} | wrong).start()


def test_one_fault_may_be_a_text():
    with serve("anyskin", "memory:", faults="drop 100%") as device:
        device.wait(0.1)
        assert device.truth.injected["drop"] > 5


def test_a_mistake_that_nobody_waits_for_is_raised_at_the_end():
    device = serve("anyskin").start()
    device.press(1e-3, taxel=77, body="ball", wait=False)
    device.wait(0.05)
    with pytest.raises(TactemuError, match="got 77"):
        device.stop()


def test_a_body_of_a_scene_file_goes_its_own_way_until_it_is_taken_and_after_it_is_given_back(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace("hold", "slide").replace('"slide"', '"slide", distance = 0.01, speed = 0.001'))
    with serve(path, steer="ball") as device:
        device.wait(0.05)
        assert device.state()["bodies"]["ball"] == {
            "position": [0, 0, 0.05], "quaternion": [1, 0, 0, 0], "movable": True, "in_hand": True
        }  # fmt: skip
    with serve(path) as device:
        device.wait(0.05)
        moving = device.state()["bodies"]["ball"]
        assert moving["position"][0] > 0 and not moving["in_hand"]
        device.press(1e-3)
        felt = device.sample()
        assert felt is not None and felt.ideal.any()
        assert device.state()["bodies"]["ball"]["in_hand"]
        device.give_back("ball")
        device.wait(0.02)
        now = device.state()
        np.testing.assert_allclose(now["bodies"]["ball"]["position"], (now["t_s"] * 1e-3, 0, 0.05), atol=1e-5)
        felt = device.sample()
        assert felt is not None and not felt.ideal.any()
    with pytest.raises(SceneError, match="steer: there is no movable body 'pad'"):
        serve(path, steer=["pad"]).start()


SCENE = """
[[body]]
name = "pad"
shape = "frame"
fixed = true
[[body]]
name = "ball"
shape = "box"
size = [0.01, 0.02, 0.03]
position = [0, 0, 0.05]
motion = { kind = "hold" }
[[skin]]
device = "anyskin"
link = "pad"
"""


def test_a_scene_files_seed_is_the_seed(tmp_path):
    (tmp_path / "scene.toml").write_text(
        "[scene]\nseed = 7\n[[body]]\nname = 'pad'\nshape = 'frame'\n[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n"
    )
    for wish, expected in ((None, 7), (3, 3)):
        with serve(tmp_path / "scene.toml", "memory:", seed=wish) as dev:
            assert dev.simulation.context.seed == expected


def test_an_unknown_option_is_refused_as_python_does():
    for name in ("rate", "seconds", "fresh_ports"):
        with pytest.raises(TypeError, match=f"unexpected keyword argument '{name}'"):
            serve("anyskin", **{name: 1})


def test_a_device_that_was_stopped_begins_anew():
    device = serve("anyskin", "memory:", clock="lockstep", seed=1)
    felt = []
    for _ in range(2):
        with device:
            device.press(1e-3)
            device.step(seconds=0.5)
            felt.append(device.sample())
    first, second = felt
    assert first.ideal.any() and first.t_ns == second.t_ns
    np.testing.assert_array_equal(first.measured, second.measured)
