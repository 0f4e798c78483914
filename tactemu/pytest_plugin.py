"""The pytest plugin: ``tactile_device`` puts a simulated sensor on a fresh port. Imports nothing until it is used.

::

    def test_my_driver(tactile_device):
        with tactile_device("anyskin", rate_hz=100, faults=["flip 5%"], seed=7) as dev:
            driver = MyDriver(dev.port)
            dev.press(depth=1e-3, seconds=2)
            assert driver.bad_frames == dev.truth.injected["flip"]
"""

from __future__ import annotations

import pytest


@pytest.fixture
def tactile_device():
    """Start devices: ``tactile_device(name_or_scene, **options)`` is :func:`tactemu.serve`, already running.

    Whatever a test leaves running is stopped after it, and an error in the background fails the test.
    """
    started = []

    def start(target, port=None, **options):
        from tactemu.serving import serve

        device = serve(target, port, **options).start()
        started.append(device)
        return device

    yield start
    for device in reversed(started):
        device.stop()
