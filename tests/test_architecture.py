"""docs/architecture.md names the files that ``scripts/trace`` finds; their number and that of the calls stay small."""

import re
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs/architecture.md"
MAX_FILES_ON_THE_WAY = 18
"""Number of files through which one sample passes; it may only fall."""
MAX_FILES = 23
"""Number of all files that it visits, also those of the loop's tools and of the log; it may only fall."""
MAX_CALLS = 184
"""Number of Python calls of one sample with its ten steps of the physics; it may only fall."""
MAX_SYSTEM_CALLS = 3
"""Number of calls of the system for one sample on a pseudo terminal that a driver reads; it may only fall."""

MAX_ANSWER_CALLS = 105
"""Number of Python calls from a request to its reply; it may only fall."""


@pytest.fixture(scope="module")
def script():
    loader = SourceFileLoader("trace_script", str(ROOT / "scripts/trace"))
    made = module_from_spec(spec_from_loader(loader.name, loader))
    loader.exec_module(made)
    return made


def test_the_page_lists_the_files_that_one_sample_visits(script):
    calls = script.trace()
    visited = set(calls)
    beside = {file for file in visited if file.startswith(script.BESIDE)}
    way, aside = PAGE.read_text().partition("## The path of one sample")[2].split("## ")[0].split("Beside the path")
    listed = [re.findall(r"^\|.*?`([a-z_/]+\.py)`", part, re.MULTILINE) for part in (way, aside)]
    assert sorted(listed[0]) == sorted(visited - beside)
    assert sorted(listed[1]) == sorted(beside)
    assert f"visits {len(visited)} files: the {len(visited - beside)} in" in " ".join(way.split())
    assert f"and {len(beside)} beside" in " ".join(way.split())
    assert len(visited - beside) <= MAX_FILES_ON_THE_WAY
    assert len(visited) <= MAX_FILES
    assert sum(functions.total() for functions in calls.values()) <= MAX_CALLS


def test_a_sample_makes_few_calls_of_the_system(script):
    calls = script.trace_system()
    assert calls["posix.write"] == 1, "a frame is written in one piece"
    assert calls.total() <= MAX_SYSTEM_CALLS


def test_an_answer_makes_few_calls(script):
    calls = script.trace_answer()
    assert not any(file.startswith("tactemu/sensors") for file in calls), "an answer does not wait for the physics"
    assert sum(functions.total() for functions in calls.values()) <= MAX_ANSWER_CALLS
