"""Saved when it is hardest: amid a frame, a fault, an outage, a boot; and what a port of another process changes."""

import functools

import pytest

from firmware_protocols.frames import frame_of
from tactemu.scene.file import default_scene
from tactemu.transports.memory import DriverEnd
from tests.emulator.saving import story

SECONDS = 0.4


def scene(*names: str, port: str | None = None, **skin) -> dict:
    """The default scenes of devices side by side, with skins that have ``skin`` in common."""
    whole: dict = {"scene": {"dt": 0.005}, "body": [], "skin": []}
    for k, name in enumerate(names):
        data = default_scene(name).tables.model_dump(by_alias=True, exclude_none=True)
        for body in data["body"]:
            place = (k + body["position"][0], *body["position"][1:])
            whole["body"].append(body | {"name": f"{body['name']}{k}", "position": place})
        for each in data["skin"]:
            own = {"port": port} if port else {}
            whole["skin"].append(each | {"name": f"{name}{k}", "link": f"{each['link']}{k}", **own, **skin})
    return whole


def build(data: dict, writes=()):
    emulator = story.build(data)
    for t_s, frame in writes:
        emulator.at(round(t_s * 1e9), functools.partial(say, emulator, frame_of(frame)))
    return emulator


def driver_of(emulator) -> DriverEnd:
    return emulator.wires[0].transport.driver


def say(emulator, frame) -> None:
    driver_of(emulator).write(frame)


def check(data: dict, saves_s, writes=(), seconds: float = SECONDS) -> list:
    """Told on from every save; returns what was heard of the whole."""
    whole, states = build(data, writes), []

    def save() -> None:
        states.append((whole.snapshot(), len(whole.truth.frames), len(whole.truth.samples)))

    with whole:
        for at_s in saves_s:
            whole.call(save, round(at_s * 1e9))
        whole.run(seconds)
    told, counted = story.heard(whole), story.counted(whole)
    assert len(states) == len(saves_s) and told[0]
    for at_s, (state, n_frames, n_samples) in zip(saves_s, states):
        other = build(data, [(t_s, frame) for t_s, frame in writes if t_s > at_s])
        other.restore(state)
        with other:
            other.run(seconds - at_s)
        assert story.heard(other) == [told[0][n_frames:], told[1][n_samples:]], f"from {at_s} s on"
        assert story.counted(other) == counted, f"from {at_s} s on"
    return told


def test_between_the_frames_of_one_sample_on_a_bus_with_other_traffic():
    """Two devices on a CAN bus: queues, arbitration, a frame on the line, a node that babbles, one that is off."""
    data = scene("xela_uskin", "icub_skin", port="memory:bus")
    data["skin"][0]["faults"] = ["load 40%", "babble 30% from 80ms to 95ms", "busoff from 105ms to 119ms"]
    starts = [(0.02, "201#0700"), *((0.03 + k / 1000, f"201#{k:02X}00") for k in range(5))]
    saves = [0.0503 + 0.0007 * k for k in range(3)] + [0.0912, 0.1101, 0.1201]
    check(data, saves, starts, 0.14)


def test_amid_the_turns_of_a_half_duplex_line():
    """Three devices on RS-485: what each has heard, answers that wait for their turn, the echo, a collision."""
    data = scene("dfrobot_tactile", "synria_60", port="memory:line")
    asks = [(0.05 + 0.011 * k, "010300000010440600"[: 16 - 4 * (k % 3)]) for k in range(20)]
    check(data, [0.0611, 0.0616, 0.0622, 0.1151, 0.2], [*asks, (0.3, "01030000001044060102")])


@pytest.mark.parametrize(
    "faults",
    [
        ["unplug from 100ms to 250ms"],
        ["latency 16ms"],
        ["reorder 50%", "merge 20%", "split 30% by 4ms", "stray 30%", "late 30% by 30ms", "duplicate 20%"],
        ["silence from 100ms to 200ms", "drop every 3", "flip at 150ms", "truncate 40%"],
    ],
    ids=["unplug", "chip", "frames", "timed"],
)
def test_in_the_middle_of_faults(faults):
    data = scene("anyskin", faults=faults, clock={"delay_s": 0.004, "jitter_s": 0.012, "skew_ppm": -900.0})
    told = check(data, [0.0995, 0.1004, 0.1733, 0.2503])
    assert len({t_ns for t_ns, _, _ in told[0]}) > 8


def test_while_a_device_boots_and_while_it_hangs():
    data = scene("orca_touch", "anyskin")
    data["scenario"] = [
        {"at": 0.1, "reset": True, "skin": "anyskin1"},
        {"at": 0.2, "until": 0.26, "hang": True},
        {"at": 0.25, "fault": "flip 50% for 100ms"},
    ]
    check(data, [0.1001, 0.23, 0.3])


def test_faults_that_were_switched_on_while_it_ran_and_are_switched_off_after():
    data = scene("anyskin")
    whole = build(data)
    with whole:
        whole.run(0.1)
        kept, gone = whole.wires[0].add_fault("flip 50%"), whole.wires[0].add_fault("late 50% by 20ms")
        whole.run(0.0512)
        state = whole.snapshot()
        mark = [len(part) for part in story.heard(whole)]
        whole.wires[0].remove_fault(gone)
        whole.run(0.1)
        told = [part[k:] for part, k in zip(story.heard(whole), mark)]
    other = build(data)
    other.restore(state)
    with other:
        assert other.wires[0].faults == [kept, gone]
        other.wires[0].remove_fault(gone)
        other.run(0.1)
    assert story.heard(other) == told
    assert other.wires[0].faults == [kept] and other.truth.injected == whole.truth.injected


def test_the_driver_that_comes_back_is_no_news_to_the_device():
    """A board that restarts when its port is opened does not, because a saved run has a new port."""
    data = scene("singletact")
    whole = build(data)
    with whole:
        whole.run(0.1)
        state, power_cycles = whole.snapshot(), whole.channels[0].power_cycles
    other = build(data)
    other.restore(state)
    with other:
        driver = driver_of(other)
        other.run(0.05)
        assert other.truth.counts["event"] == whole.truth.counts["event"], "not opened again"
        assert other.channels[0].power_cycles == power_cycles
        driver.close()
        other.run(0.01)
        driver.open()
        other.run(0.01)
        assert other.truth.counts["event"] == whole.truth.counts["event"] + 2, "but what it does then is"
