"""Programs in C that stand for drivers which are on no index; a skip where nobody may make a view."""

import subprocess
from pathlib import Path

import pytest

from tactemu.base.errors import TransportUnavailable
from tactemu.exec.build import NoLibrary, compiler, library
from tactemu.exec.keeping import Keeper

PROGRAMS = Path(__file__).parent / "programs"


@pytest.fixture(scope="session", autouse=True)
def view_allowed():
    keeper = Keeper()
    try:
        keeper.wait()
    except TransportUnavailable as error:
        pytest.skip(str(error))
    keeper.close()


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    """``compiled("vendor")`` is ``programs/vendor.c`` as a program; further words are the compiler's."""
    folder = tmp_path_factory.mktemp("programs")
    try:
        command = compiler()
    except NoLibrary as error:
        pytest.skip(str(error))

    def make(name, *words):
        target = folder / "-".join((name, *(word.strip("-") for word in words)))
        if not target.exists():
            subprocess.run([*command, "-o", target, PROGRAMS / f"{name}.c", "-lpthread", *words], check=True)
        return str(target)

    return make


@pytest.fixture(scope="session")
def preload():
    """The preload library."""
    try:
        return library()
    except NoLibrary as error:
        pytest.skip(str(error))
