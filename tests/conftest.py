"""Marks that need something of the machine: skipped with the command that provides it. A CAN port of our own."""

import gc
import json
import os
from pathlib import Path

import pytest

import tests.fuzz
import tests.run_folder  # noqa: F401  (usual ports and sockets are of this process alone)

# On Linux a driver on one multicast group hears every other group on its port, so tests that run at the same time
# would hear each other. python-can reads this variable, in this process and in those of the drivers. Workers of
# pytest-xdist inherit it from the process that started them and need one of their own.
if "CAN_CONFIG" not in os.environ or "PYTEST_XDIST_WORKER" in os.environ:
    os.environ["CAN_CONFIG"] = json.dumps({"port": 20_000 + os.getpid() % 20_000})

# Threads of linear algebra that wait for one another by spinning take many times as long on a busy machine. Before the
# first import of numpy, and for the processes that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests import judging
from tests.drivers import rig


def pytest_addoption(parser):
    parser.addoption(
        "--judges", default="changed", help="drivers to run: changed (see tests/judging.py), all, or devices"
    )
    parser.addoption(
        "--devices", choices=("changed", "all"), default="changed", help="those that long tests of each device try"
    )
    parser.addoption("--judges-to", type=Path, metavar="FILE", help="add a line of JSON for each judge")


def pytest_configure(config):
    if config.getoption("--judges-to"):
        config.pluginmanager.register(judging.Verdicts(config.getoption("--judges-to")))


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect without the garbage collector, which would visit all that was imported again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


MANY_OBJECTS = 200_000
"""So many that outlive two collections are mostly garbage of earlier tests, such as the truth of their emulators."""


@pytest.fixture(scope="module", autouse=True)
def little_garbage():
    """Leave all that exists out of the garbage collections to come: each would take half a second to visit it.

    And free the garbage of earlier modules now: a loop in real time would stand still for seconds while it is freed.
    """
    if not gc.get_freeze_count():
        gc.collect()
        gc.freeze()
    elif len(gc.get_objects(generation=2)) > MANY_OBJECTS:
        gc.collect()


def pytest_collection_modifyitems(config, items):
    """Leave out what ``--judges`` and ``--devices`` say, and skip what this machine or this run does not offer."""
    judging.deselect(config, items)
    reasons = {}
    if any(item.get_closest_marker("gpu") for item in items) and not _has_gpu():
        reasons["gpu"] = "no CUDA device on this machine"
    if "VCAN_GUEST" not in os.environ:
        reasons["vcan"] = "real Linux CAN: scripts/vcan-run -- python -m pytest -m vcan"
    if "KERNEL_GUEST" not in os.environ:
        reasons["guest"] = "serial ports of a real kernel: scripts/kernel-guest -n -- python -m pytest -m guest"
    if "kernel" not in config.option.markexpr:
        reasons["kernel"] = "a guest with a kernel of its own: python -m pytest -m kernel"
    if "idle" not in config.option.markexpr:
        reasons["idle"] = "an idle machine: python -m pytest -m idle"
    if "nightly" not in config.option.markexpr:
        reasons["nightly"] = "it takes minutes: python -m pytest -m nightly"
    for item in items:
        for mark in filter(item.get_closest_marker, reasons):
            item.add_marker(pytest.mark.skip(reason=reasons[mark]))


def _has_gpu():
    import warp

    from tactemu.base import kernels

    kernels.start_warp()
    return warp.is_cuda_available()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    judge = judging.judge_of(item)
    if call.when == "setup":
        rig.EQUAL.clear()
    if judge and (call.when == "call" or report.outcome != "passed"):
        report.user_properties.append(("judge", judging.verdict(judge, report)))
    return report


def pytest_terminal_summary(terminalreporter, config):
    if said := judging.rule(config):
        terminalreporter.write_line(said)
