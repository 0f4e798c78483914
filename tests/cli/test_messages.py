"""A mistake is one sentence: the nearest right word, and the next step."""

import shlex

import pytest

import tactemu as tt
from firmware_protocols.options import Declared, Option
from tests.cli.command import ROOT, here

PAD = '[[body]]\nname = "pad"\nshape = "box"\nsize = [0.1, 0.1, 0.01]\n[[skin]]\ndevice = "anyskin"\nlink = "pad"\n'


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run anyskn", "unknown device 'anyskn'; did you mean 'anyskin'?"),
        ("run qqqqqq", "unknown device 'qqqqqq'; `tactemu devices` lists them (your own: path/to/file.py:Class, or "),
        ("run tests", "'tests' is a folder; name a device, a scene file or path/to/device.py:Class"),
        ("run tests/look.py", "tests/look.py: name the class in it, as tests/look.py:Class\n"),
        ("run anyskin -- python a.py", "run starts no command; write: tactemu exec anyskin -- python a.py"),
        (
            "sweep examples/hand.toml",
            "examples/hand.toml: this is a scene file, not a plan; a plan has [[driver]] tables",
        ),
        ("run anyskin --port /dev/ttyUSB0", "at the other end of its cable, write 'serial:/dev/ttyUSB0'"),
        ("tune anyskin --rate 1e9", "command line: --rate must be >= 0.001 and <= 1e+06 Hz, got 1000000000.0"),
        ("poke press --depth 1kg", "got the text '1kg'; on a command line it may have a unit: "),
        ("poke press", "press: --depth is missing: depth of the body's foremost point below the untouched surface"),
        ("poke press", "; example: tactemu poke press --depth 1mm\n"),
        ("poke dead", "dead: TAXELS is missing: their numbers; 3:7 are 3, 4, 5, 6; example: tactemu poke dead 3,4\n"),
        ("run anyskin --port /tmp/x", "port '/tmp/x': a path needs its scheme; did you mean 'pty:/tmp/x'?"),
        ("run anyskin --port ptty:/tmp/x", "port 'ptty:/tmp/x': unknown scheme 'ptty'; did you mean 'pty'?"),
        (
            "run xela_uskin --port pty:/tmp/x",
            "into pty:; ports that fit: can:, slcan:, socketcand:, gsusb:, memory: (wi",
        ),
        ("run anyskin gains=3", "option gains: expected 3 values, such as [1, 2, 3], got '3'"),
        ("run anyskin gains=[1,2]", "option gains: expected 3 values, such as [1, 2, 3], got '[1,2]'"),
        ("run anyskin gains=[1,2,x]", "option gains: expected a number, got 'x'"),
        (
            "run anyskin --port memory: --fault 'drop 1'",
            "fault 'drop 1': '1': a share needs its unit; did you mean '1%'?",
        ),
        (
            "run anyskin --port memory: --fault 'drop x'",
            "'x': unknown word; expected at, from, to, for, N%, every, frame, ",
        ),
        ("run anyskin --truth /tmp/nodir/x.mcap", "cannot write the truth log: there is no folder /tmp/nodir; make it"),
        ("new nodir/scene.toml", "nodir/scene.toml: cannot write it: there is no folder nodir; make it first"),
        ("infer nothere.mcap -o x.py", "nothere.mcap: cannot read it: No such file"),
        ("run anyskin --rate -5", "command line: --rate must be >= 0.001 and <= 1e+06 Hz, got -5.0"),
        ("run anyskin --rate 5m", "--rate: expected a rate such as 100 or 100Hz, got '5m'"),
        ("run anyskin --seconds 2kg", "--seconds: expected a time such as 90s, 500ms or 5m, got '2kg'"),
        ("judge anyskin --budget soon -- true", "--budget: expected a time such as 90s, 500ms or 5m, got 'soon'"),
        (
            "judge anyskin --patience 11m -- true",
            "command line: --patience must be >= 0.1 and <= 600 s, got 66",
        ),
        ("run anyskin --rate touch=100", "no stream 'touch': anyskin has one stream; give the rate alone"),
        ("run anyskin --fault 'flip 5% id=0x28'", "'id=': a serial wire has no identifiers; name frames by prefix=HEX"),
    ],
)
def test_a_mistake_in_a_command(words, sentence):
    import shlex

    done = here(*shlex.split(words), cwd=ROOT)
    assert done.returncode == 2 and sentence in done.stderr and len(done.stderr) < 400, done.stderr


@pytest.mark.parametrize(
    ("table", "where"),
    [
        ('faults = ["drop 1%", "drop 101%"]', "skin[0] 'anyskin'.faults[1]: 'drop 101%': "),
        (
            '[[scenario]]\nat = 1.0\nreset = true\n[[scenario]]\nat = 1.0\nfault = "unplg for 1s"',
            "scenario[1].fault: 'unplg for 1s': unknown kind 'unplg'; did you mean 'unplug'?",
        ),
    ],
)
def test_a_fault_of_a_scene_that_is_wrong_is_named_with_its_place(table, where, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(PAD + table)
    done = here("run", str(scene), "--port", "memory:", "--seconds", "0.1")
    assert done.returncode == 2 and f"{scene}: {where}" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("[[skin]]", "[skin]", "skin: write [[skin]] instead of [skin]"),
        ("[[body]]", "[body]", "body: write [[body]] instead of [body]"),
        (
            "[[body]]",
            '[scene]\ndt = "1ms"\n[[body]]',
            "scene.dt: must be a number >= 1e-07 and <= 10 s, got the text '1ms'",
        ),
        (
            "[[body]]",
            "[[scenario]]\ndead = [40]\n[[body]]",
            "scenario[0]: dead: expected taxels 0..4 of 'anyskin', got [40]",
        ),
        (
            "[[body]]",
            "[[scenario]]\nset = {nois = 1}\n[[body]]",
            "scenario[0]: set: 'nois' cannot change; did you mean",
        ),
        ("link", "port = 5\nlink", "skin[0] 'anyskin'.port: expected a text, got 5"),
        ("anyskin", "anyskni", "skin 'anyskni': unknown device 'anyskni'; did you mean 'anyskin'?"),
    ],
)
def test_a_mistake_in_a_scene_file_is_named_with_the_file(before, after, message, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(PAD.replace(before, after))
    for words in (["explain", str(scene), "--no-cost"], ["run", str(scene), "--port", "memory:", "--seconds", "0.1"]):
        done = here(*words)
        assert done.returncode == 2 and f"tactemu: {scene}: {message}" in done.stderr, done.stderr


def test_a_mistake_in_a_live_command_names_it():
    with tt.serve("anyskin", "memory:") as dev, pytest.raises(TypeError, match=r"^set: missing a required argument"):
        dev.set(gain=0.9)  # type: ignore[call-arg]


@pytest.mark.parametrize("device", ["allegro_v5_plus", "optoforce"])
def test_a_datasheet_has_single_backticks_and_keeps_its_columns(device):
    lines = here("devices", device).stdout.splitlines()
    assert lines and not any("``" in line for line in lines)
    columns = {line.index("to hand") for line in lines if "remote   " in line or "`<u2 x 3`" in line}
    assert len(columns) <= 1, columns


def test_a_fault_without_a_share_says_that_it_hits_every_frame():
    words = ("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "0.1", "--fault")
    assert "fault 'drop': it hits every frame; for one in ten write 'drop 10%'\n" in here(*words, "drop").stderr
    assert "every frame" not in here(*words, "drop 1%").stderr


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("unplug --for 500ms", "unplug for 0.5 s: every skin\n"),
        ("unplug --for 500", "unplug for 500 s: every skin\n"),
        ("unplug --for 5m", "unplug for 300 s: every skin\n"),
        ("unplug", "unplug: every skin, until `tactemu poke mend`\n"),
        ("set gain=0.9 --taxels 1:3", "set gain=0.9 taxels 1,2: every skin, until the run ends\n"),
        ("dead 3,4 --skin anyskin --for 1s", "dead 3,4 for 1 s: anyskin\n"),
        ("hang --for 1s", "hang for 1 s: every skin\n"),
        ("fault 'drop 5%'", "fault drop 5%: every skin, until `tactemu poke mend`\n"),
        ("fault 'drop 5% for 1s' --skin anyskin", "fault drop 5% for 1s: anyskin\n"),
        ("mend", "mend: every skin\n"),
        ("reset", "reset: every skin\n"),
        ("happen dead=[3] until=2", "happen dead=[3] until=2\n"),
        ("press --depth 1mm --no-wait", "press depth 0.001 m: until `tactemu poke release`\n"),
        ("press anyskin --depth 1mm --dwell 1ms", "press depth 0.001 m dwell 0.001 s: anyskin\n"),
        ("release --no-wait", "release: until it is moved again\n"),
        ("move ball 0 0 25mm --for 1ms", "move ball (0, 0, 0.025) m for 0.001 s: until it is moved again\n"),
        ("pose ball 0 0 25mm", "pose ball (0, 0, 0.025) m: until it is moved again\n"),
        ("give_back", "give_back: every body, until it is moved again\n"),
        ("wait 1ms", ""),
        ("wait 1ms --json", '{"ok": true, "result": null}\n'),
        ("fault drop --json", '{"ok": true, "result": null}\n'),
    ],
)
def test_a_command_that_lasts_says_until_when(words, line):
    with tt.serve("anyskin", "memory:", adjustable=["gain", "dead"], name="lasting"):
        done = here("poke", *shlex.split(words), "--name", "lasting")
    assert (done.returncode, done.stdout) == (0, line), done.stderr


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda dev: dev.press(1e-3, taxl=3), TypeError, "keyword argument 'taxl'; did you mean 'taxel'?"),
        (lambda dev: dev.set({"nois": 1}), tt.SceneError, "no imperfection 'nois'; did you mean 'noise'?"),
        (lambda dev: dev.set({"noise": 1}), tt.SceneError, "`adjustable=['noise']` in Python, `tactemu run ... --ad"),
    ],
)
def test_a_wrong_name_in_a_live_command_has_only_the_hint_that_helps(call, error, message):
    with tt.serve("anyskin", "memory:") as dev, pytest.raises(error) as raised:
        call(dev)
    assert message in str(raised.value) and (message[-1] != "?" or str(raised.value).endswith(message))


def test_a_log_without_can_frames_says_what_takes_it(tmp_path):
    log = tmp_path / "t.mcap"
    run = ("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "0.1", "--truth", str(log))
    assert here(*run).returncode == 0
    done = here("truth", str(log), "--to", str(tmp_path / "bus.log"))
    assert (
        done.stderr
        == f"tactemu: {log}: no CAN frames in it; a .csv or .jsonl file holds the frames of every kind of line\n"
    )


def test_no_summary_of_a_command_is_cut():
    lines = here("--help").stdout.splitlines()
    assert [line for line in lines[1:] if line.endswith("...")] == []


def test_the_link_is_gone_when_unplug_returns(tmp_path):
    port = tmp_path / "port"
    with tt.serve("anyskin", f"pty:{port}") as dev:
        for _ in range(20):
            dev.unplug()
            assert not port.exists()
            dev.mend()
            assert port.exists()


def test_a_mistake_in_a_live_command_does_not_speak_of_a_scenario():
    with tt.serve("anyskin", "memory:", adjustable=["noise"]) as dev:
        with pytest.raises(tt.TactemuError, match=r"^taxels: expected taxels 0\.\.4 of 'anyskin', got"):
            dev.set({"noise": 0.1}, taxels=[3, 7])


def test_a_default_of_an_option_is_short_where_it_is_shown():
    assert str(Declared("gains", float, (26.416666666666668, 2.0), Option())) == "gains = (26.4167, 2.0)"
