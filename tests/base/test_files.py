"""What is written to a path that a user gave: whole, through links, and never in place of a device node."""

import os
import stat
import threading

import pytest

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_folder, check_writable, move_into_place, writing
from tests.cli.command import tactemu


def test_a_file_stays_as_it_was_until_all_is_written(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"before")
    path.chmod(0o640)
    with pytest.raises(ZeroDivisionError), writing(path) as file:
        file.write(b"half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"before" and list(tmp_path.iterdir()) == [path]
    with writing(path) as file:
        file.write(b"after")
    assert path.read_bytes() == b"after" and stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.parametrize("way", ["writing", "moving"])
def test_a_link_is_followed(tmp_path, way):
    link, target = tmp_path / "link", tmp_path / "folder" / "target"
    target.parent.mkdir()
    link.symlink_to(target)
    write(link, way)
    assert link.is_symlink() and target.read_bytes() == b"x"


@pytest.mark.parametrize("way", ["writing", "moving"])
def test_a_fifo_is_written_to_and_stays(tmp_path, way):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    found = []
    reader = threading.Thread(target=lambda: found.append(fifo.read_bytes()))
    reader.start()
    write(fifo, way)
    reader.join(10)
    assert found == [b"x"] and stat.S_ISFIFO(fifo.stat().st_mode)


def write(path, way):
    if way == "writing":
        with writing(path) as file:
            file.write(b"x")
    else:
        made = path.parent / "made"
        made.write_bytes(b"x")
        move_into_place(made, path)


def test_a_path_that_cannot_be_written_is_refused_before(tmp_path):
    for path, why in ((tmp_path, "is a folder"), (tmp_path / "no" / "x", f"no folder {tmp_path / 'no'}")):
        with pytest.raises(TactemuError, match=f"{path}: cannot write the state: .*{why}"):
            check_writable(path, "the state")
    check_writable(tmp_path / "x", "the state")


def test_a_folder_that_cannot_be_written_is_refused_and_none_is_made(tmp_path):
    file = tmp_path / "file"
    file.touch()
    for path in (file, file / "folder", file / "folder" / "in_it"):
        with pytest.raises(TactemuError, match=f"^{path}: cannot write logs: {file}: Not a directory$"):
            check_folder(path, "logs")
    for path in (tmp_path, tmp_path / "new" / "folder"):
        check_folder(path, "logs")
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.skipif(os.getuid() != 0, reason="only root makes device nodes")
def test_a_state_that_is_saved_onto_a_device_node_leaves_the_node(tmp_path):
    node = tmp_path / "n"
    os.mknod(node, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    done = tactemu("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "0.2", "--save", node)
    assert done.returncode == 0, done.stderr
    assert stat.S_ISCHR(node.stat().st_mode)


def test_a_state_that_cannot_be_saved_is_refused_before_the_run():
    done = tactemu(
        "run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "0.2", "--save", "/no/x.npz"
    )
    assert done.returncode == 2 and not done.stdout
    said = "tactemu: /no/x.npz: cannot write the state: there is no folder /no; make it first"
    assert done.stderr.splitlines() == [said]
