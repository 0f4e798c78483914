"""The command line is light, and its help teaches."""

import json
import re
import subprocess
import sys

import pytest
from typer.main import get_command

import firmware_protocols
from tactemu.cli import control, listing
from tactemu.cli.app import app
from tactemu.cli.datasheet import taxel_map
from tactemu.cli.fitting import cell_lines, filled, fitted
from tests.cli.command import ROOT, environment, here

COMMANDS = [name for name, command in get_command(app).commands.items() if not hasattr(command, "commands")]
LIGHT = {
    # what is asked most often: what of ours and others' it must not wait for
    "--help": ("typer", "numpy", "warp", "trimesh", "can", "firmware_protocols.device"),
    "devices": ("typer", "numpy", "warp", "trimesh", "can", "rich", "firmware_protocols.device"),
}


@pytest.mark.parametrize("word", LIGHT)
def test_nothing_heavy_is_imported(word):
    code = (
        f"import sys; from tactemu.cli import main; sys.argv = ['tactemu', {word!r}]\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"print('HEAVY', [m for m in {LIGHT[word]} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(),
        timeout=30,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "HEAVY []"
    for each in COMMANDS if word == "--help" else firmware_protocols.DEVICES:
        assert each in done.stdout


def test_a_narrow_terminal_gets_narrow_help():
    done = subprocess.run(
        [sys.executable, "-m", "tactemu", "--help"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment() | {"COLUMNS": "60"},
        timeout=30,
        check=True,
    )
    assert "  check       Check a device file of your own." in done.stdout


def commands_below(command, *names):
    """Yield a command and all below it, with their names."""
    yield command, names
    for name, below in getattr(command, "commands", {}).items():
        yield from commands_below(below, *names, name)


@pytest.mark.parametrize("root", [get_command(app), get_command(control.make_app())], ids=["tactemu", "tactemu poke"])
def test_help_fits_80_columns_with_whole_summaries(root, request, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    for _, names in commands_below(root):
        with pytest.raises(SystemExit):
            root.main([*names, "--help"], prog_name=request.node.callspec.id)
        lines = capsys.readouterr().out.splitlines()
        assert [line for line in lines if len(line) > 80] == []
        summaries = lines[lines.index("Commands:") :] if "Commands:" in lines else []
        assert [line for line in summaries if line.endswith("...")] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_examples(command):
    done = here(command, "--help")
    assert done.returncode == 0
    assert f"    tactemu {command}" in done.stdout, "an example to copy"


def test_devices_lists_the_registry():
    done = here("devices")
    assert done.returncode == 0
    for name in firmware_protocols.names():
        assert name in done.stdout


def test_devices_are_listed_by_kind_however_many_and_however_wide(monkeypatch):
    rows = [row | {"name": f"{row['name']}_{k}"} for k in range(5) for row in listing.rows()]
    for width in (80, 160):
        lines = listing.table(rows, width)
        assert max(map(len, lines)) <= width
        assert [line for line in lines if line in listing.KINDS.values()] == [
            heading for kind, heading in listing.KINDS.items() if any(row["kind"] == kind for row in rows)
        ]


@pytest.mark.parametrize(
    "words", ["devices", "devices paxini_px6ax", "faults", "examples", "explain examples/hand.toml --no-cost"]
)
def test_listings_fit_80_columns_with_whole_words(words):
    lines = here(*words.split(), columns=80).stdout.splitlines()
    assert lines and [line for line in lines if len(line) > 80] == []
    wide = set(here(*words.split(), columns=1000).stdout.split())
    assert {word for line in lines for word in line.split()} - wide <= set("also prints rates, drivers.".split()) | {
        "`tactemu", "devices", "NAME`", "evidence"
    }  # fmt: skip


def test_paragraphs_are_filled_and_rows_of_a_table_go_on_below_their_last_column():
    assert [*filled(["one two", "three"], 9), *filled(["one two", "", "three"], 6)] == [
        "one two", "three", "one", "two", "", "three",
    ]  # fmt: skip
    row = "  a   " + " ".join(["word"] * 15)
    assert [*fitted([f"{row} more", "g h i j k l m"], 12)] == [row, "      more", "g h i j k l", "m"]
    assert len(row) == 80, "a row of a table has at least this width"
    assert cell_lines("vendor/a-long-name@123", 10) == ["vendor/a-", "long-name@", "123"]


def test_devices_that_no_file_lists_are_imported(monkeypatch):
    monkeypatch.setitem(firmware_protocols.DEVICES, "template", "firmware_protocols.template:VendorModel")
    monkeypatch.setitem(firmware_protocols.DEVICES, "broken", "firmware_protocols.template:Nothing")
    text = here("devices").stdout
    assert "Template, a 4x4 pad" in text
    assert "broken" in text and "cannot be made: AttributeError" in text
    rows = {row["name"]: row for row in json.loads(here("devices", "--json").stdout)}
    assert rows["template"]["taxels"] == 16 and set(rows["broken"]) == {"name", "error"}


def test_a_datasheet_has_everything():
    done = here("devices", "anyskin")
    for word in ("Ports", "Senses", "Commands", "taxel  on wire", "Evidence", "Read by", "Sources", "Assumed"):
        assert word in done.stdout, word
    assert "1   0   2" in done.stdout, "the picture of the cross"


@pytest.mark.parametrize("arguments", [("run",), ("run", "anyskin", "--rte", "3"), ("nosuch",), ("explain",)])
def test_wrong_usage_exits_with_2(arguments):
    done = here(*arguments)
    assert done.returncode == 2
    assert done.stderr and not done.stdout


def test_version():
    done = here("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("tactemu ")


def test_every_device_named_in_an_example_exists():
    text = "".join(here(command, "--help").stdout for command in ("run", "faults", "devices", "explain"))
    named = set(re.findall(r"tactemu (?:run|explain|devices) ([a-z_0-9]+)(?: |\n)", text))
    assert named and named <= {*firmware_protocols.names()}, named


@pytest.mark.parametrize("name", firmware_protocols.names())
def test_a_datasheet_is_no_longer_than_one_reads(name):
    lines = here("devices", name).stdout.splitlines()
    layout = firmware_protocols.create(name).layout
    assert len(lines) < 400
    if len(layout) > 100:
        assert all(any(line.startswith(f"  {patch.name} ") for line in lines) for patch in layout.patches)


def test_a_large_pad_is_summed_up():
    layout = firmware_protocols.grid_layout(96, 200, 0.002)
    assert taxel_map(layout)[2:] == [
        f"  {layout.patches[0].name}  0 to 19199, 96 rows of 200, from (-199.00, 95.00, 0.00) to (199.00, -95.00, 0.00)"
    ]


@pytest.mark.parametrize(("words", "offered"), [("tactemu run any", "anyskin"), ("tactemu ex", "explain")])
def test_a_shell_completes_commands_and_devices(words, offered, monkeypatch):
    monkeypatch.setenv("_TACTEMU_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert offered in here().stdout.split()


class InterruptsImports:
    """Ctrl-C while the commands are being imported."""

    def find_spec(self, name, path=None, target=None):
        if name == "tactemu.cli.app":
            raise KeyboardInterrupt


def test_an_early_interrupt_is_no_traceback(monkeypatch):
    monkeypatch.delitem(sys.modules, "tactemu.cli.app")
    monkeypatch.setattr(sys, "meta_path", [InterruptsImports(), *sys.meta_path])
    done = here("faults")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def every_command(group, path=()):
    """Yield the words and the command of each command, those of groups and of `poke` too."""
    for name, command in group.commands.items():
        if name == "poke":
            yield from every_command(get_command(control.make_app()), ("poke",))
        elif hasattr(command, "commands"):
            yield from every_command(command, (*path, name))
        else:
            yield (*path, name), command


EVERY = dict(every_command(get_command(app)))
GROUPS = {(): get_command(app), ("poke",): get_command(control.make_app())} | {
    (name,): command for name, command in get_command(app).commands.items() if hasattr(command, "commands")
}


def help_at_80(command, words):
    """The lines of the help of a command on a terminal of 80 columns."""
    with command.context_class(command, info_name=" ".join(("tactemu", *words)), terminal_width=80) as context:
        return command.get_help(context).splitlines()


@pytest.mark.parametrize("words", GROUPS, ids=" ".join)
def test_summaries_are_whole_at_80_columns(words):
    lines = help_at_80(GROUPS[words], words)
    listed = lines[lines.index("Commands:") + 1 :]
    assert listed and not [line for line in listed if line.endswith("...")]
    assert max(map(len, listed)) <= 80


MAX_OPTIONS_IN_A_ROW = 8
"""Options in a section of a help; a command with more has sections."""


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_a_help_has_an_example_and_few_options_in_a_row(words):
    lines = help_at_80(EVERY[words], words)
    assert any(line.startswith(f"    tactemu {' '.join(words)}") for line in lines), lines
    assert not any("sudo tactemu" in line for line in lines), "root's PATH has no virtual environment: $(which tactemu)"
    sections: dict[str, int] = {}
    for line in lines:
        if line and line[0] != " ":
            title = line
        sections[title] = sections.get(title, 0) + line.startswith("  -")
    assert max(sections.values()) <= MAX_OPTIONS_IN_A_ROW, sections
