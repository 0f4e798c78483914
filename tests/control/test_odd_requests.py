"""Every command with odd values for each of its arguments: refused in words, with the loop as it was."""

import re

import pytest

import tactemu as tt
from tactemu.control.control_commands import CONTROL_COMMANDS
from tests.control.test_server import Raw

ODD = (
    None, True, -1, 0, 1e-320, 1e308, 1 << 99, "", "x", "\u0000", "x" * 2000, [], [1], [None], [[1]], [0, 0, 0],
    [0, 0, 0, 0], [1e-320, 0, 0, 0], {}, {"x": 1}, {"noise": None}, {"noise": [[1]]}, {"": {"": []}},
)  # fmt: skip
EVENT = ("at", "until", "skin", "fault", "set", "taxels", "dead", "value", "hang", "reset")
NEEDED = {
    "press": {"depth": 1e-3}, "move": {"position": [0, 0, 0.03]}, "pose": {"body": "ball"},
    "fault": {"fault": "drop 1%"}, "set": {"options": {"noise": 0.0}}, "dead": {"taxels": [0]},
    "hang": {"seconds": 0.0},
    "lines": {"dtr": True, "rts": True}, "wait": {"seconds": 0.0}, "save": {}, "restore": {},
}  # fmt: skip
"""Arguments with which a command is done, so that the odd one is looked at."""
OF_PYTHON = re.compile(
    r"Traceback|\w+(Error|Exception|Warning)\b|<class|object at 0x|NoneType|ndarray|numpy|pydantic|is not defined"
    r"|unhashable|has no attribute|\b(dict|list|tuple|str|int|float|bool)\b object|_\w+\(\)"
)


def requests():
    for name, verb in CONTROL_COMMANDS.items():
        arguments = EVENT if name == "happen" else [*verb.arguments]
        for argument in arguments:
            for odd in ODD:
                if (name, argument) not in (("save", "file"), ("wait", "seconds")) or not isinstance(odd, str | int):
                    at_once = {"wait": False} if "wait" in arguments else {}
                    yield name, at_once | NEEDED.get(name, {}) | {argument: odd}
    for first in EVENT:
        yield "happen", {first: [1], "reset": True}
        yield "happen", {"dead": [0], "set": {"noise": 1.0}, first: {"x": [1]}}


@pytest.fixture
def dev(runtime_folder):
    options = {"name": "skin", "adjustable": ["noise", "dead"], "clock": "lockstep"}
    with tt.serve("anyskin", "memory:", rate_hz=20, **options) as device:
        yield device


def test_odd_arguments_are_refused_in_words(dev, runtime_folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wrong = []
    with Raw(runtime_folder) as raw:
        for name, arguments in requests():
            said = raw.ask(name, **arguments)
            if not said["ok"] and (OF_PYTHON.search(said["error"]) or len(said["error"]) > 600):
                wrong.append((name, arguments, said["error"]))
        assert not wrong, wrong[:5]
        assert raw.ask("step", seconds=0.1)["ok"]
