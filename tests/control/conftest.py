"""Sockets in a folder of the test's own, so that no other run on this machine is seen."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def runtime_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        yield folder / "tactemu"
