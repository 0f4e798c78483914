"""Scene files that ask for what cannot be: one sentence, exit status 2, nothing opened and no traceback.

Each file in ``tests/data/hostile`` begins with what is said of it.
"""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactemu.base.errors import SceneError, TactemuError
from tactemu.cli import main
from tactemu.scene import file
from tactemu.scene.scene import Scene
from tests.fuzz import examples

FOLDER = Path(__file__).parents[1] / "data" / "hostile"
FILES = sorted(FOLDER.glob("*.toml"))


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_a_hostile_scene_is_one_sentence(path, monkeypatch, capsys):
    says = path.read_text().partition("\n")[0].removeprefix("# says: ")
    port = [] if path.stem.startswith("port_") else ["--port", "memory:"]
    monkeypatch.chdir(FOLDER)
    monkeypatch.setattr(
        sys, "argv", ["tactemu", "run", path.name, *port, "--clock=virtual", "--seconds", "0.01", "--json"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    assert ended.value.code == 2
    assert said.err.startswith("tactemu: ") and says in said.err
    assert said.err.count("\n") == 1 and len(said.err) < 600
    assert said.out == ""


NO_SCENES = {
    "empty": (b"", "the file is empty; `tactemu new FILE` writes a scene"),
    "a byte order mark alone": (b"\xef\xbb\xbf", "the file is empty"),
    "comments": (b"# nothing\n", "the file is empty"),
    "binary": (bytes(range(256)), "not a text file"),
    "utf-16": ("[scene]".encode("utf-16"), "not a text file"),
    "another language": (b"<scene/>", "not valid TOML"),
    "deep": (b"a = " + b"[" * 2000 + b"]" * 2000, "nested too deep"),
    "skins that are none": (b"skin = 3\n", "skin: expected a list, got 3"),
    "no skin": (b"skin = []\n", "skin: expected one [[skin]] or more"),
    "a body that is none": (b"body = [3]\n[[skin]]\ndevice = 'anyskin'\n", "body[0]: expected a table, got 3"),
    "no device": (b"[[skin]]\nlink = 'pad'\n", "skin[0].device: missing key"),
}


@pytest.mark.parametrize("name", NO_SCENES)
def test_what_is_no_scene_is_named(tmp_path, name):
    content, says = NO_SCENES[name]
    (tmp_path / "x.toml").write_bytes(content)
    with pytest.raises(SceneError) as error:
        file.load(tmp_path / "x.toml")
    assert says in str(error.value)


def test_a_byte_order_mark_before_a_scene_is_no_part_of_it(tmp_path):
    text = "[[body]]\nname = 'pad'\nshape = 'frame'\n[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n"
    (tmp_path / "x.toml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert file.load(tmp_path / "x.toml").tables == file.parse(text).tables


@examples(100)
@given(st.binary(max_size=60) | st.text(alphabet="[]{}=\"'.,#\n ab13-e", max_size=60).map(str.encode))
def test_whatever_a_file_holds_it_is_a_scene_or_an_error_of_ours(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(content)
    try:
        file.load(path)
    except TactemuError as error:
        assert str(error).startswith(f"{path}: ")


@pytest.mark.parametrize("dt", [0, 4e-10, -1.0, float("nan"), float("inf"), "1e-3", True, None])
def test_a_step_that_time_cannot_count_is_refused(dt):
    with pytest.raises(SceneError, match=r"Scene: dt must be (a number )?>= 1e-07 and <= 10 s"):
        Scene(dt=dt)


CODE = {
    "a device file": ("device = 'mine.py:Mine'", "names mine.py:Mine, Python code"),
    "a model of one's own": ("device = 'anyskin'\nmodel = 'mine.py:Taxel'", "names mine.py:Taxel, Python code"),
}


@pytest.mark.parametrize("name", CODE)
def test_a_scene_that_names_code_can_be_refused(tmp_path, name, monkeypatch):
    skin, says = CODE[name]
    (tmp_path / "mine.py").write_text("raise SystemExit('it ran')\n")
    (tmp_path / "x.toml").write_text(f"[[body]]\nname = 'pad'\nshape = 'frame'\n[[skin]]\nlink = 'pad'\n{skin}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["tactemu", "explain", "x.toml", "--no-code"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    with pytest.raises(SceneError, match=says):
        file.load("x.toml", code=False)
    with pytest.raises(SceneError, match="this is Python code, which would be run"):
        file.load(f"{os.curdir}/mine.py:Mine", code=False)
