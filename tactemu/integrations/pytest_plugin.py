"""The pytest plugin: the fixture ``tactile_device`` puts a simulated sensor on a fresh port.

::

    def test_my_driver(tactile_device):
        with tactile_device("anyskin", rate_hz=100, faults=["flip 5%"], seed=7) as dev:
            driver = MyDriver(dev.port)
            dev.press(depth=1e-3, dwell=2)
            assert driver.bad_frames == dev.truth.injected["flip"]

``--tactemu-seed N`` is the seed of devices whose test names none. ``--tactemu-truth-dir DIR`` keeps a truth log and a
picture of every device of each failed test; the test's report names them, and the last lines of the run the folder.
You may also set both in pytest's ini file, as ``tactemu_seed`` and ``tactemu_truth_dir``, or in the environment, in
capitals.

A message of tactemu's for you stands under the line of yours that it is about; ``--full-trace`` shows the frames
between them.

Tests that use the fixture have the marker ``tactemu`` (``pytest -m tactemu``). If you write the marker yourself, its
arguments are those of the devices of the test, class or module: ``@pytest.mark.tactemu(rate_hz=200)``. The plugin
imports the rest of tactemu only when a test uses it.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Unpack

import pytest

if TYPE_CHECKING:
    from tactemu.session.options import ServeOptions
    from tactemu.session.serving import Served

_LOGGED = pytest.StashKey[list[tuple["Served", Path]]]()
"""Devices of a test with the truth logs that the plugin removes; a picture has the log's name and another suffix."""
_FAILED = pytest.StashKey[bool]()
"""True for a test that has failed."""
_KEPT = "tactemu kept"
"""The property of a report that says that files were kept; it also reaches the process that prints the summary."""


class TactileDevice(Protocol):
    """The type of the fixture, for annotations: ``tactile_device: TactileDevice``."""

    def __call__(
        self, target: str | Path, port: str | Mapping[str, str] | None = None, **options: Unpack[ServeOptions]
    ) -> Served:
        """Return a running device; the arguments are those of :func:`tactemu.serve`."""
        ...


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's options, and the same as keys of the ini file."""
    group = parser.getgroup("tactemu", "simulated tactile skins")
    seed = "seed of tactile devices whose test names none"
    group.addoption("--tactemu-seed", metavar="N", default=None, help=seed)
    parser.addini("tactemu_seed", help=seed)
    folder = "folder that keeps truth logs and pictures of failed tests"
    group.addoption("--tactemu-truth-dir", metavar="DIR", default=None, help=folder)
    parser.addini("tactemu_truth_dir", help=folder)


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker, and refuse a wrong seed and a folder that cannot be written before any test runs."""
    config.addinivalue_line(
        "markers",
        "tactemu(**options): a test that uses tactile_device; the options are those of its devices, as for serve()",
    )
    _seed(config)
    if folder := _setting(config, "tactemu_truth_dir"):
        from tactemu.base.errors import TactemuError
        from tactemu.base.files import check_folder

        try:
            check_folder(folder, "truth logs of failed tests")
        except TactemuError as error:
            raise pytest.UsageError(f"--tactemu-truth-dir: {error}") from None


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark a test that uses the fixture, and refuse a marker with positional arguments."""
    for mark in item.iter_markers("tactemu"):
        if mark.args:
            raise pytest.UsageError(f"{item.nodeid}: pytest.mark.tactemu takes options by name, such as rate_hz=200")
    if "tactile_device" in getattr(item, "fixturenames", ()):
        item.add_marker("tactemu")


@pytest.fixture
def tactile_device(request: pytest.FixtureRequest) -> Iterator[TactileDevice]:
    """Start devices: ``tactile_device(name_or_scene, **options)`` is :func:`tactemu.serve`, already running.

    Options that the test does not name are those of its markers. Devices that a test leaves running are stopped after
    it, and an error in the background fails the test.
    """
    item = request.node
    started: list[Served] = []
    logged = item.stash.setdefault(_LOGGED, [])
    marked: dict[str, Any] = {}
    for mark in item.iter_markers("tactemu"):  # the closest comes first
        marked = mark.kwargs | marked

    def start(target: str | Path, port: str | Mapping[str, str] | None = None, **options: Any) -> Served:
        from tactemu.session.serving import serve

        options = marked | ({} if port is None else {"port": port}) | options
        if "seed" not in options and (seed := _seed(request.config)) is not None:
            options["seed"] = seed
        folder = None if "truth" in options else _setting(request.config, "tactemu_truth_dir")
        if folder:
            options["truth"] = _log(Path(folder), item.nodeid, len(logged) + 1)
        device = serve(target, **options).start()
        started.append(device)
        if folder:
            logged.append((device, options["truth"]))
        return device

    yield start
    try:
        for device in reversed(started):
            device.stop()
    except BaseException:
        item.stash[_FAILED] = True
        raise
    finally:
        if not item.stash.get(_FAILED, False):
            for _, log in logged:
                log.unlink(missing_ok=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[Any]) -> Iterator[Any]:
    """Shorten the traceback of a failed test, draw its devices as they are, and name the kept files in its report."""
    if call.excinfo is not None:
        _hide_own_frames(call.excinfo)
    report = yield
    if report.failed:
        item.stash[_FAILED] = True
        kept = [line for device, log in item.stash.get(_LOGGED, []) for line in (str(log), _draw(device, log))]
        if kept:
            report.sections.append(("truth and pictures of tactile devices", "\n".join(kept)))
            report.user_properties.append((_KEPT, True))
    return report


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the folder of the kept files, if there are any."""
    reports = [*terminalreporter.getreports("failed"), *terminalreporter.getreports("error")]
    kept = [report for report in reports if (_KEPT, True) in map(tuple, getattr(report, "user_properties", ()))]
    tests = {report.nodeid for report in kept}  # a file that cannot be collected has no properties
    if tests:
        folder = Path(_setting(config, "tactemu_truth_dir") or "").absolute()
        some = "a test that failed" if len(tests) == 1 else f"{len(tests)} tests that failed"
        terminalreporter.write_line(f"tactemu: truth and pictures of {some}: {folder}")


def _hide_own_frames(failure: pytest.ExceptionInfo[BaseException]) -> None:
    """Mark tactemu's modules in a traceback: pytest hides their frames under an error with a message for users."""
    for entry in filter(_is_own, failure.traceback):
        entry.frame.f_globals["__tracebackhide__"] = _has_message


def _has_message(failure: pytest.ExceptionInfo[BaseException]) -> bool:
    """Return True if a ``raise`` statement of tactemu's has raised the error."""
    last = failure.traceback[-1]
    return _is_own(last) and str(last.statement).lstrip().startswith("raise ")


def _is_own(entry: Any) -> bool:
    return entry.frame.f_globals.get("__name__", "").partition(".")[0] in ("tactemu", "firmware_protocols")


def _draw(device: Served, log: Path) -> str:
    """Draw a picture beside a device's log, and return its path, or the reason why there is none."""
    from tactemu.session.picture import save_picture

    picture = log.with_suffix(".svg")
    try:
        if not picture.exists():
            save_picture(device.emulator, picture)
    except Exception as error:
        return f"{picture}: not drawn: {error!r}"
    return str(picture)


def _setting(config: pytest.Config, name: str) -> str | None:
    given = config.getoption(f"--{name.replace('_', '-')}") or os.environ.get(name.upper())
    return given or config.getini(name) or None


def _seed(config: pytest.Config) -> int | None:
    text = _setting(config, "tactemu_seed")
    if text is None:
        return None
    try:
        return int(text)
    except ValueError:
        raise pytest.UsageError(f"--tactemu-seed: expected a whole number, got {text!r}") from None


def _log(folder: Path, nodeid: str, number: int) -> Path:
    """Return a file for the ``number``-th device of a test; make its folder, and remove a picture of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^A-Za-z0-9.]+", "-", nodeid)[-150:].strip("-")
    if "[" in nodeid:  # parameters may differ in characters that a file's name cannot have
        name += f"-{hashlib.sha256(nodeid.encode()).hexdigest()[:8]}"
    log = folder.absolute() / f"{name}-{number}.mcap"
    log.with_suffix(".svg").unlink(missing_ok=True)
    return log
