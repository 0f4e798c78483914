"""Marks that need something of the machine: skipped with the command that provides it. A CAN port of our own."""

import json
import os

import pytest

import tests.fuzz  # noqa: F401  (the profile of all random tests)

# On Linux a driver on one multicast group hears every other group on its port, so tests that run at the same time
# would hear each other. python-can reads this variable, in this process and in those of the drivers.
os.environ.setdefault("CAN_CONFIG", json.dumps({"port": 20_000 + os.getpid() % 20_000}))

# Threads of linear algebra that wait for one another by spinning take many times as long on a busy machine. Before the
# first import of numpy, and for the processes that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_modifyitems(config, items):
    """Real Linux CAN is there where ``scripts/vcan-run`` says so; elsewhere these tests are skipped, but not in it.
    What measures rates would fail on a machine that does other work.
    """
    reasons = {}
    if "VCAN_GUEST" not in os.environ:
        reasons["vcan"] = "real Linux CAN: scripts/vcan-run -- python -m pytest -m vcan"
    if "realtime" not in config.option.markexpr:
        reasons["realtime"] = "an idle machine: python -m pytest -m realtime"
    for item in items:
        for mark in filter(item.get_closest_marker, reasons):
            item.add_marker(pytest.mark.skip(reason=reasons[mark]))
