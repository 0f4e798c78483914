"""Two suites that run at once share neither ports nor sockets: each process of tests has a folder of its own."""

import os
import subprocess
import sys
import tempfile

from tactemu.control import endpoints
from tests.run_folder import RUN_FOLDER

MAX_SOCKET_PATH = 100
LONGEST_NAME = "n" * 40


def test_ports_and_sockets_lie_in_the_folder_of_this_process():
    assert tempfile.gettempdir() == os.environ["TMPDIR"] == os.environ["XDG_RUNTIME_DIR"] == str(RUN_FOLDER)
    of_child = [sys.executable, "-c", "import tempfile; print(tempfile.gettempdir())"]
    assert subprocess.run(of_child, capture_output=True, text=True, check=True).stdout.strip() == str(RUN_FOLDER)
    assert len(str(endpoints.folder() / f"{LONGEST_NAME}.sock")) < MAX_SOCKET_PATH


def test_pytest_keeps_its_folders_where_they_were(tmp_path):
    assert RUN_FOLDER not in tmp_path.parents
