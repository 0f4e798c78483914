"""The public names of ``tactemu``."""

import importlib

import pytest

import tactemu


@pytest.mark.parametrize("name", tactemu.__all__)
def test_every_public_name_is_there(name):
    assert getattr(tactemu, name).__name__ == name


def test_serve_is_the_function_however_often_it_is_used():
    assert callable(tactemu.serve)
    module = importlib.import_module("tactemu.serving")
    assert tactemu.serve is module.serve


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Sphera'"):
        tactemu.Sphera  # noqa: B018
