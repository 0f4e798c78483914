"""`device` is where kernels run, for `serve`, `build` and every command; in a scene file that is `[scene] compute`."""

import click
import pytest
from typer.main import get_command

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.cli.app import app
from tactemu.integrations.target import device_for
from tactemu.scene import file
from tests.scenes import ball, pad

SCENE = pad(0.04, 0.04, 0.002) + ball(0.012, [0.0, 0.0, 0.1]) + "[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n"


def test_serve_takes_the_device_that_runs_the_kernels():
    with tt.serve("anyskin", "memory:", device="cpu") as dev:
        assert str(dev.simulation.device) == "cpu"
    with pytest.raises(SceneError, match=r"no device 'flexitac' on this machine .*; kernels run on: cpu"):
        tt.serve("anyskin", "memory:", device="flexitac").start()
    with pytest.raises(TypeError, match="unexpected keyword argument 'compute'"):
        tt.serve("anyskin", compute="cpu")


def test_a_driver_s_url_takes_it():
    with device_for("anyskin?device=cpu", "memory:") as dev:
        assert str(dev.simulation.device) == "cpu"
    with pytest.raises(SceneError, match="no device 'cuda:77'"):
        device_for("anyskin?device=cuda:77", "memory:").start()


def test_a_scene_file_says_compute():
    loaded = file.parse("[scene]\ncompute = 'cuda:0'\n" + SCENE)
    assert loaded.tables.scene.compute == "cuda:0" and loaded.tables.skin[0].device == "anyskin"
    with pytest.raises(
        SceneError, match="unknown key 'device': `compute` runs the kernels; `device` is a key of skins"
    ):
        file.parse("[scene]\ndevice = 'cuda:0'\n" + SCENE)


def commands(group, path=()):
    """Yield each command of the command line with its words."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield " ".join((*path, name)), command


def test_device_means_the_same_in_every_command():
    found = {
        name: option.help
        for name, command in commands(get_command(app))
        for option in command.params
        if "--device" in option.opts
    }
    assert {"run", "exec", "explain", "tune", "dataset"} <= found.keys()
    assert all(text.startswith("Where kernels run: cpu or cuda:0") for text in found.values()), found
