"""Who runs: two emulators, one that was killed, a process with the number of another, a folder of a stranger."""

import json
import os
import socket
from pathlib import Path

import pytest

import tactemu as tt
from tactemu.base.errors import TactemuError, TransportError
from tactemu.control import endpoints
from tactemu.control.endpoints import Endpoint, Owner, running, started
from tests.cli.command import here, start


def test_two_emulators_and_a_crashed_one_are_told_apart(runtime_folder):
    victim = start("run", "anyskin", "--json")
    try:
        assert victim.stdout and '"ready"' in victim.stdout.readline()
        with tt.serve("anyskin", name="anyskin-2"):
            assert {owner.name: owner.pid for owner in running()} == {"anyskin": victim.pid, "anyskin-2": os.getpid()}
            done = here("poke", "stats")
            assert done.returncode == 2 and not done.stdout
            assert "several emulators run; choose one with --name" in done.stderr
            assert all(name in done.stderr and name in here("poke").stdout for name in ("anyskin ", "anyskin-2"))
            assert here("poke", "press", "--depth", "1mm", "--name", "anyskin").returncode == 0
            others = json.loads(here("poke", "stats", "--json", "--name", "anyskin-2").stdout)["result"]["clients"]
            assert others == {"accepted": 1, "commands": 1}, "the press was not for this one"
            with pytest.raises(TransportError, match=f"--name anyskin: process {victim.pid} has this name"):
                tt.serve("anyskin", name="anyskin").start()
            victim.kill()
            victim.wait(10)
            assert (runtime_folder / "anyskin.sock").exists(), "nobody has tidied up"
            assert here("poke", "stats").returncode == 0, "one that runs is taken"
            assert not list(runtime_folder.glob("anyskin.*")), "what the dead left is removed"
            said = here("poke", "stats", "--name", "anyskin").stderr
            assert "no emulator 'anyskin' runs; did you mean 'anyskin-2'?; choose one of" in said
    finally:
        victim.kill()
    assert running() == [] and [each.name for each in runtime_folder.iterdir()] == [".lock"]


def test_the_number_of_a_process_alone_proves_nothing(runtime_folder):
    """The owner is gone, and another process has its number."""
    runtime_folder.mkdir(mode=0o700, exist_ok=True)
    assert started(os.getpid()) > 0 and started(2**30) == 0
    reused = Owner("old", os.getpid(), started(os.getpid()) - 1, "anyskin")
    assert not reused.alive
    (runtime_folder / "old.json").write_text(json.dumps(vars(reused)))
    socket.socket(socket.AF_UNIX).bind(str(runtime_folder / "old.sock"))
    assert [owner.name for owner in running()] == []
    assert not list(runtime_folder.glob("old.*"))


@pytest.mark.parametrize("said", [b"", b"[]", b"{", b'{"pid": "x"}', b"\xff", b"[" * 10_000])
def test_a_socket_of_which_nobody_says_whose_it_is_is_nobodys(runtime_folder, said):
    runtime_folder.mkdir(mode=0o700, exist_ok=True)
    (runtime_folder / "who.json").write_bytes(said)
    (runtime_folder / "who.sock").touch()
    assert running() == [] and not (runtime_folder / "who.sock").exists()


@pytest.mark.parametrize("case", ["open to others", "a link", "a file", "a stranger's"])
def test_a_folder_that_is_not_ours_alone_is_not_used(tmp_path, monkeypatch, case):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = tmp_path / "tactemu"
    if case == "a link":
        (tmp_path / "else").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "else")
    elif case == "a file":
        folder.touch()
    else:
        folder.mkdir(mode=0o755 if case == "open to others" else 0o700)
    if case == "a stranger's":
        monkeypatch.setattr(endpoints.os, "getuid", lambda: folder.stat().st_uid + 1)
    for use in (running, lambda: Endpoint("x", "anyskin", exactly=True).take(), tt.connect):
        with pytest.raises(TransportError, match=r"not your private folder.*mode 0700"):
            use()
    assert not folder.is_dir() or not list(folder.iterdir())


def test_a_run_goes_on_where_there_can_be_no_socket(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    arguments = ("run", "anyskin", "--port", "memory:", "--clock=virtual", "--seconds", "0.05", "--json")
    done = here(*arguments)
    assert done.returncode == 0 and "`tactemu poke` will not find this run" in done.stderr
    named = here(*arguments, "--name", "skin")
    assert named.returncode == 2 and "is missing" in named.stderr and not named.stdout


def test_without_a_runtime_folder_there_is_one_for_temporary_files(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(endpoints.tempfile, "gettempdir", lambda: str(tmp_path))
    taken = Endpoint("my hand.toml", "my hand.toml", exactly=False)
    taken.take().close()
    assert taken.path is not None and taken.path == Path(tmp_path, f"tactemu-{os.getuid()}", "my-hand-toml.sock")
    folder = taken.path.parent
    assert folder.stat().st_mode & 0o777 == 0o700
    taken.leave()
    assert [each.name for each in folder.iterdir()] == [".lock"]


@pytest.mark.parametrize("name", ["", "a/b", "../x", "-x", "a" * 41, "ä"])
def test_a_name_is_one(name):
    with pytest.raises(TactemuError, match="expected letters, digits"):
        Endpoint(name, "anyskin", exactly=True)


def test_a_path_that_is_too_long_is_said(tmp_path, monkeypatch):
    long = tmp_path / ("x" * 90)
    long.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(long))
    with pytest.raises(TransportError, match="too long for a socket; set XDG_RUNTIME_DIR"):
        Endpoint("skin", "anyskin", exactly=True).take()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["press"], "press: --depth is missing"),
        (["press", "--depth", "1mm"], "no emulator runs; start one: tactemu run anyskin"),
        (["press", "--depth", "1mm", "--name", "x"], "no emulator 'x' runs"),
        (
            ["press", "--depth", "1kg"],
            "press: depth must be a number >= -0.5 and <= 0.5 m (6 mm is 0.006), got the text '1kg'",
        ),
        (["pose", "ball", "0", "0", "-1parsec"], "pose: position must be numbers"),
        (["pose", "ball", "0", "0"], "pose: position must be 3 numbers"),
        (["set", "gain"], "set: options must be a table"),
        (["happen", "fault"], "happen: expected KEY=VALUE"),
        (["dead", "7:3"], "dead: taxels must be numbers"),
        (["prss"], "No such command 'prss'"),
        (["press", "--dept", "1mm"], "No such option: --dept"),
    ],
)
def test_a_slip_on_the_command_line_is_one_message_and_exit_status_2(words, says):
    done = here("poke", *words)
    assert done.returncode == 2 and says in done.stderr and not done.stdout
