"""What was done live is in the truth log, and done again from there it gives the same bytes."""

import hashlib
import time

import pytest

import tactemu as tt
from tactemu.base.clock import LockstepClock, VirtualClock
from tactemu.base.errors import TactemuError
from tactemu.control.command_replay import commands_of, replay_commands
from tactemu.control.control import Control
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.scene.steering import steered
from tactemu.truth import Truth

COMMANDS = [
    # when [s], what, with what
    (0.10, "press", {"depth": 1e-3, "taxel": 0, "dwell": 0.2}),
    (0.13, "fault", {"fault": "flip 20% for 0.3s"}),
    (0.25, "set", {"options": {"noise": 0.02}, "taxels": [1], "seconds": 0.3}),
    (0.25, "dead", {"taxels": [2], "value": 0.5, "seconds": 0.1}),
    (0.31, "hang", {"seconds": 0.05}),
    (0.60, "reset", {}),
    (0.75, "pose", {"body": "ball", "position": [0.0, 0.0, 0.0195]}),
    (0.80, "unplug", {}),
    (0.90, "mend", {}),
    (0.95, "give_back", {}),
]


def made(device, clock, log=None):
    run_options = AssemblyOptions(port="memory:", seed=3, adjustable=("noise", "dead"))
    truth = Truth(log)
    return Control(assemble(steered(file.load(device)), run_options, clock=clock, truth=truth)), truth


def digest(truth) -> str:
    said = [(t_ns, device, frame) for t_ns, device, frame in truth.frames]
    samples = [(s.t_ns, s.number, s.measured.tobytes(), s.counts.tobytes()) for s in truth.samples]
    assert len(said) > 50
    return hashlib.sha256(repr((said, samples)).encode()).hexdigest()


def played_again(device, log) -> str:
    control, truth = made(device, VirtualClock())
    assert replay_commands(control, log) == len(commands_of(log))
    with control.emulator:
        control.emulator.run(1.195)
    return digest(truth)


@pytest.mark.parametrize("suffix", [".jsonl", ".mcap"])
def test_a_run_that_was_poked_at_is_the_same_again(tmp_path, suffix):
    """Given between steps of time that stands, in one process; done again on a clock that runs by itself."""
    control, truth = made("anyskin", LockstepClock(), tmp_path / f"log{suffix}")
    emulator = control.emulator
    with emulator:
        for t_s, verb, args in [*COMMANDS, (1.195, "", {})]:
            emulator.clock.go_on(round(t_s * 1e9))  # type: ignore[attr-defined]
            while not emulator.clock.is_paused():
                emulator.step()
            if verb:
                control.submit(verb, CONTROL_COMMANDS[verb].checked(args), "a test")
                emulator.step()
    again = commands_of(tmp_path / f"log{suffix}")
    assert [(c.t_ns / 1e9, c.verb) for c in again] == [(t_s, verb) for t_s, verb, _ in COMMANDS]
    assert {c.by for c in again} == {"a test"}
    assert played_again("anyskin", tmp_path / f"log{suffix}") == digest(truth)
    untouched, other = made("anyskin", VirtualClock())
    with untouched.emulator:
        untouched.emulator.run(1.195)
    assert digest(other) != digest(truth), "the commands did nothing"


def test_a_run_in_real_time_is_felt_again(tmp_path):
    """Given from another thread at whatever moment: every sample that both have took the same values."""
    log = tmp_path / "log.jsonl"
    with tt.serve("anyskin", "memory:", seed=3, truth=log, rate_hz=200, by_hand=False) as dev:
        for k in range(6):
            dev.press(1e-3, dwell=0.01, taxel=k % 5, speed=0.2)
            dev.set_pose("ball", position=(0, 0, 0.03))
            time.sleep(0.0137)
        dev.wait(0.05)
        dev.give_back()
        dev.wait(0.1)
    felt = {s.t_ns: s.ideal.tobytes() for s in dev.truth.samples}
    loaded = steered(file.load("anyskin"))
    control = Control(assemble(loaded, AssemblyOptions(port="memory:", seed=3, rate_hz=200), clock=VirtualClock()))
    replay_commands(control, log)
    with control.emulator:
        control.emulator.run(max(felt) / 1e9 + 1e-3)
    again = {s.t_ns: s.ideal.tobytes() for s in control.emulator.truth.samples}
    assert felt.keys() <= again.keys()
    assert len(set(felt.values())) > 5, "the presses were felt, on a machine that may be busy"
    assert [t for t in felt if felt[t] != again[t]] == []


def test_a_log_tells_what_was_done(tmp_path):
    control, _ = made("anyskin", VirtualClock(), tmp_path / "log.mcap")
    with control.emulator:
        control.submit("press", CONTROL_COMMANDS["press"].checked({"depth": 1e-3}))
        control.submit("stats", {})
        control.emulator.run(0.1)
    log = tt.read_log(tmp_path / "log.mcap")
    assert list(log) == ["anyskin"] and len(log.commands) == 1
    assert '"verb": "press"' in log.commands[0].what


@pytest.mark.parametrize(
    "what",
    [
        "command {",
        "command 3",
        'command {"verb": "restore", "args": {"file": "x.state"}}',
        'command {"verb": "stats", "args": {}}',
        'command {"verb": "press", "args": {"depth": "x"}}',
    ],
)
def test_a_log_with_a_strange_command_is_refused(tmp_path, what):
    truth = Truth(tmp_path / "log.jsonl")
    truth.event(1_500_000_000, "", what)
    truth.close()
    with pytest.raises(TactemuError, match=r"log.jsonl: command at 1.5 s: "):
        commands_of(tmp_path / "log.jsonl")
