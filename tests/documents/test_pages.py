"""The blocks of every page run as they are written, in order, in one folder; the output that a page shows appears.

A comment before a block says what is not run, or at night only, and why; it is invisible on the page::

    <!-- not run: it needs a CAN adapter -->
    <!-- nightly: it takes minutes -->
    <!-- not run lines with `record`, `/dev/tty`: they need a real sensor -->

The options of a command that is not run are parsed all the same. ``python -m tests.documents`` lists what is not run.
Blocks ``sh`` are commands, ``output`` what they print, with … for anything and numbers that may be others; ``text`` is
a drawing. Blocks with a file's name are files in the folder; blocks of Python share one namespace.
"""

import contextlib
import functools
import json
import os
import re
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tactemu.base.errors import TransportUnavailable
from tactemu.exec.keeping import Keeper
from tests.documents import props
from tests.documents.blocks import PAGES, ROOT, Block, blocks_of, commands_of
from tests.documents.terminal import Terminal, words_of

BLOCKS = {page.name: blocks_of(page) for page in PAGES}
LANGUAGES = {"sh", "python", "toml", "json", "yaml", "output", "text"}
OWN_TESTS = {"tutorial.md": "tests/test_tutorial.py"}
"""Pages that another test runs, in a shell."""


@pytest.fixture
def terminal(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / ".runtime"))
    (tmp_path / ".runtime").mkdir(mode=0o700)
    typed = Terminal(tmp_path)
    yield typed
    typed.kill()


def run_page(name: str, mark: str, terminal: Terminal, request: pytest.FixtureRequest) -> None:
    """Run the blocks of a page: all that have no mark, and those with ``mark``."""
    if any(re.search(r"^tactemu exec|exec_environment", block.text, re.MULTILINE) for block in BLOCKS[name]):
        need_view()
    reader = props.prepare(name, terminal.folder)
    names: dict = {"__name__": "page", **reader.names}
    shown: str | None = None
    for block in BLOCKS[name]:
        text = reader.on_this_machine(block.text)
        if block.name:
            write(block, text, terminal)
        elif block.language == "sh":
            shown = type_all(block, text, mark, terminal)
        elif block.language == "python" and block.marked("") in ("", mark):
            if "connect(" not in text:
                terminal.interrupt()
            execute(block, text, names, request)
        elif block.language == "output" and shown is not None:
            missing = [line for line in text.splitlines() if not pattern(line).search(shown)]
            assert missing == [], f"{block.place}: not in\n{shown}"
    terminal.interrupt()


def need_view() -> None:
    """Skip the test where this machine allows no view of itself."""
    keeper = Keeper()
    try:
        keeper.wait()
    except TransportUnavailable as error:
        pytest.skip(str(error))
    keeper.close()


def write(block: Block, text: str, terminal: Terminal) -> None:
    """Write a block with a file's name; the second of a name is added, or replaces the first where it begins anew."""
    path = terminal.folder / block.name
    path.parent.mkdir(exist_ok=True, parents=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(text)


def type_all(block: Block, text: str, mark: str, terminal: Terminal) -> str | None:
    """Type the commands, and return what they print; None if some are not run."""
    output: str | None = ""
    for command in commands_of(text):
        if block.marked(command) in ("", mark):
            said = terminal.type(command)
            output = None if output is None else output + said
        else:
            output = None
    return output


def execute(block: Block, text: str, names: dict, request: pytest.FixtureRequest) -> None:
    """Run Python, and the tests that it defines with their fixtures."""
    before = set(names)
    exec(compile(text, block.place, "exec"), names)
    for name in [name for name in names if name.startswith("test_") and name not in before]:
        test = names[name]
        test(*(request.getfixturevalue(word) for word in test.__code__.co_varnames[: test.__code__.co_argcount]))


def pattern(line: str) -> re.Pattern[str]:
    """Return an expression for a line of output: numbers may be others, spaces more or fewer, … stands for anything."""
    words = re.escape(line.strip()).replace("…", ".*")
    words = re.sub(r"(\\ )+", r"\\s+", words)
    return re.compile(re.sub(r"-?\d+(\\\.\d+)?", r"-?[\\d.]+", words))


def runnable(mark: str) -> list[str]:
    """Return the pages with something to run under this mark."""
    found = []
    for name, blocks in BLOCKS.items():
        here = [block for block in blocks if block.language in ("sh", "python") and not block.name]
        if name not in OWN_TESTS and any(block.marked(each) == mark for block in here for each in pieces(block)):
            found.append(name)
    return found


def pieces(block: Block) -> list[str]:
    """Return what a mark may hold for: commands, or the block."""
    return list(commands_of(block.text)) if block.language == "sh" else [""]


@pytest.mark.parametrize("name", runnable(""))
def test_its_blocks_run(name, terminal, request):
    run_page(name, "", terminal, request)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", runnable("nightly"))
def test_its_long_blocks_run(name, terminal, request):
    run_page(name, "nightly", terminal, request)


@pytest.mark.parametrize("name", BLOCKS)
def test_each_block_has_a_language_and_each_mark_a_reason(name):
    page = next(page for page in PAGES if page.name == name).read_text(encoding="utf-8")
    assert len(re.findall(r"^ *```", page, re.MULTILINE)) == 2 * len(BLOCKS[name]), "a block that is none of ours"
    assert page.count("<!-- not run") + page.count("<!-- nightly") == sum(len(block.marks) for block in BLOCKS[name])
    for block in BLOCKS[name]:
        assert block.language in LANGUAGES, f"{block.place}: {block.language or 'no language'}"
        for mark in block.marks:
            assert len(mark.reason) > 8, f"{block.place}: why?"
            for word in mark.words:
                assert any(word in command for command in pieces(block)), f"{block.place}: no {word}"


@functools.cache
def command_line():
    """Return the command of all commands; to make it takes a quarter of a second."""
    from typer.main import get_command

    from tactemu.cli.app import app

    return get_command(app)


@pytest.mark.parametrize("name", BLOCKS)
def test_commands_that_are_not_run_have_options_that_exist(name):
    tactemu = command_line()
    for block in BLOCKS[name]:
        for command in commands_of(block.text) if block.language == "sh" else ():
            words = words_of(re.sub(r"^(sudo )?(\S*/|\$\(which )?tactemu\)? ", "tactemu ", command))
            if words and (block.marked(command) or name in OWN_TESTS):
                words = words[: words.index("--")] if "--" in words else words
                with contextlib.ExitStack() as stack:
                    context = stack.enter_context(tactemu.make_context("tactemu", list(words)))
                    found, sub, rest = tactemu.resolve_command(context, words)
                    stack.enter_context(sub.make_context(found, rest, parent=context))


@pytest.mark.parametrize(
    "name", [name for name, blocks in BLOCKS.items() if any(b.language == "toml" and not b.name for b in blocks)]
)
def test_tables_are_those_of_a_scene(name, tmp_path):
    from tactemu.scene import file as scenes

    for block in BLOCKS[name]:
        if block.language == "toml" and not block.name:
            data = tomllib.loads(block.text)
            scenes.check(props.completed(data), source=block.place, folder=tmp_path)


def test_objects_are_json_and_the_action_has_the_inputs_that_a_page_gives_it():
    inputs = yaml.safe_load((ROOT / "action.yml").read_text())["inputs"]
    for block in (block for blocks in BLOCKS.values() for block in blocks):
        if block.language == "json":
            rows = block.text.splitlines()
            for text in rows if all(row.startswith('{"') for row in rows) else [block.text]:
                json.loads(text)
        if block.language == "yaml":
            for step in yaml.safe_load(block.text):
                assert set(step["with"]) <= set(inputs), block.place
