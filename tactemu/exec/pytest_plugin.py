"""The pytest fixture ``exec_environment``: devices of a test as hardware of the machine.

::

    def test_my_driver(exec_environment):
        exec_environment("anyskin").run(["python", "driver.py"], check=True)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Unpack

import pytest

if TYPE_CHECKING:
    from tactemu.exec.environment import ExecEnvironment
    from tactemu.session.options import ServeOptions
    from tactemu.session.serving import Served


class ExecEnvironments(Protocol):
    """The type of the fixture, to annotate a test with: ``exec_environment: ExecEnvironments``."""

    def __call__(
        self, *devices: Served | str | Path, nodes: str | Mapping[str, str] = "", **options: Unpack[ServeOptions]
    ) -> ExecEnvironment:
        """Return a view in which the devices are plugged in; a device given by name is started with ``options``."""
        ...


@pytest.fixture
def exec_environment(tactile_device: Callable[..., Served]) -> Iterator[ExecEnvironments]:
    """Yield a callable that plugs devices in: ``exec_environment("anyskin").run(["python", "driver.py"])``.

    Arguments are those of :func:`tactemu.exec_environment`; a name or a scene stands for ``tactile_device(name)``.
    """
    with ExitStack() as stack:

        def start(
            *devices: Served | str | Path, nodes: str | Mapping[str, str] = "", **options: Any
        ) -> ExecEnvironment:
            from tactemu.exec.environment import ExecEnvironment

            served = [tactile_device(each, **options) if isinstance(each, str | Path) else each for each in devices]
            return stack.enter_context(ExecEnvironment(served, nodes))

        yield start
