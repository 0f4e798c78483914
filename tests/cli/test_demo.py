"""``tactemu see --demo``: a scene and its page by one command, ended by Ctrl-C."""

import importlib.util
import re
import signal
import urllib.request
from unittest import mock

import pytest

from tests.cli.command import here, start


def test_it_prints_a_link_that_opens_and_ends_by_ctrl_c(tmp_path, monkeypatch):
    pytest.importorskip("viser", reason="the page comes with the extra web")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with start("see", "--demo") as process:
        assert process.stdout is not None and process.stderr is not None
        said = ""
        while not (link := re.search(r"^(http\S+)", said, re.MULTILINE)):
            line = process.stdout.readline()
            assert line, process.stderr.read()
            said += line
        with urllib.request.urlopen(link[1], timeout=60) as page:
            assert page.headers.get_content_type() == "text/html"
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert process.stdout.read() + process.stderr.read() == ""
    assert "no driver is needed" in said and "Ctrl-C ends it" in said


def test_without_the_extra_it_says_what_to_install():
    with mock.patch.object(importlib.util, "find_spec", return_value=None):
        answer = here("see", "--demo")
    assert (answer.returncode, answer.stdout) == (2, "")
    assert answer.stderr == 'tactemu: the page needs the package viser: pip install "tactemu[web]"\n'
