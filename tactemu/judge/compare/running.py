"""A whole comparison: the port or the capture, the model, the dialogue, the judgement and the files."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_protocols import Command, Connector, Device
from firmware_protocols.frames import text_of
from tactemu.base.errors import TactemuError
from tactemu.base.files import check_folder, check_overwriting
from tactemu.base.style import PAGE_SIGN
from tactemu.emulator.replay import line_note
from tactemu.judge.compare import presses as pressing
from tactemu.judge.compare.asking import stages_of
from tactemu.judge.compare.comparison import Comparison, compare, late_commands, requests_in
from tactemu.judge.compare.dialogue import Dialogue
from tactemu.judge.compare.link import MAX_KEPT_BYTES, Link, buffering_s, open_port
from tactemu.judge.compare.model import Model, learn_model, port_of
from tactemu.judge.compare.report import CompareReport
from tactemu.judge.compare.specimen import measured_table
from tactemu.judge.report import written
from tactemu.scene.building import make_device
from tactemu.truth.recorder import Recorder
from tactemu.truth.recording import load

CAPTURE = "capture.mcap"
"""The name of the capture in the folder of a comparison."""
REPORT_JSON, REPORT_PAGE, PRESSES = "report.json", "report.html", "presses.csv"
"""The names of the other files in that folder."""


@dataclass
class Wanted:
    """The request for a comparison."""

    device: str
    source: str
    """A port as for `tactemu record`, ``udp:HOST:PORT``, or a capture."""
    options: Mapping[str, Any] = field(default_factory=dict)
    port: str = ""
    """The name of the device's port; default: the first that fits the source."""
    baud: int | None = None
    seconds: float = 10.0
    """The time for which the sensor is listened to [s]."""
    listens: bool = False
    """True: nothing is sent."""
    asks_all: bool = False
    """True: all documented requests are sent, also those that change something."""
    press_s: float | None = None
    """The time for each guided press [s]; ``None``: the user presses nothing."""
    presses: Path | None = None
    """A file with the presses in a capture."""
    folder: Path = Path()
    """The folder for the capture and the reports."""
    command: str = ""
    """The command line, which the report shows."""


@dataclass
class Teller:
    """The ways in which a comparison talks to the user."""

    progress: Callable[[str], object] = lambda text: None
    """Is called with what is being done."""
    say: Callable[[str], object] = print
    """Prints a line."""
    is_stopped: Callable[[], bool] = bool
    """Returns True when the user wants to end."""

    def learning(self, text: str) -> None:
        """Show progress before anything is sent.

        Raises:
            KeyboardInterrupt: the user wants to end; there is nothing to judge yet.
        """
        if self.is_stopped():
            raise KeyboardInterrupt
        self.progress(text)


def run(wanted: Wanted, teller: Teller) -> CompareReport:
    """Compare a real sensor, or a capture of one, with its model, and write all files.

    Raises:
        KeyboardInterrupt: the user has ended it before anything was compared.
        TactemuError: the request is invalid, or the port or the capture cannot be read.
    """
    device = make_device(wanted.device, dict(wanted.options))
    is_capture = Path(wanted.source).is_file()
    connector = _port_of(device, wanted, is_capture)
    for name, sign in _signs(device).items():
        check_overwriting(wanted.folder / name, sign)
    _make_folder(wanted.folder)
    with _model_errors(wanted.device), _without_empty(wanted.folder):
        comparison, report = (
            _of_capture(wanted, device, connector, teller) if is_capture
            else _of_sensor(wanted, device, connector, teller)
        )  # fmt: skip
    _write(report, comparison, wanted, device)
    return report


def _port_of(device: Device, wanted: Wanted, is_capture: bool) -> Connector:
    if not is_capture or wanted.port:
        return port_of(device, wanted.port, wanted.source)
    kind = load(wanted.source).kind
    return port_of(device, "", "can:" if kind == "can" else "") if kind == "can" else device.ports[0]


@contextmanager
def _model_errors(device: str) -> Iterator[None]:
    from firmware_protocols.calls import AuthorError

    try:
        yield
    except AuthorError as error:
        raise TactemuError(f"the model {device} fails: {error}") from error


@contextmanager
def _without_empty(folder: Path) -> Iterator[None]:
    """Remove the folder again if nothing was written to it."""
    try:
        yield
    finally:
        with suppress(OSError):  # it has files, which stay
            folder.rmdir()


def _make_folder(folder: Path) -> None:
    check_folder(folder, "the reports")
    folder.mkdir(parents=True, exist_ok=True)


def _make(wanted: Wanted) -> Callable[..., Device]:
    return lambda **more: make_device(wanted.device, {**wanted.options, **more})


# -- a sensor ----------------------------------------------------------------------------------------------------------


def _of_sensor(
    wanted: Wanted, device: Device, connector: Connector, teller: Teller
) -> tuple[Comparison, CompareReport]:
    commands, left_out = chosen(device, connector, wanted)
    _announce(commands, left_out, wanted, teller)
    capture = wanted.folder / CAPTURE
    port = open_port(wanted.source, connector, wanted.baud)
    try:
        model = learn_model(wanted.device, _make(wanted), connector, commands, teller.learning)
        with Recorder(capture, line=line_note(wanted.source, wanted.baud)) as recorder:
            port.read()  # what came before is older than the capture
            link = Link(port, recorder, teller.is_stopped)
            presses = _talk(link, model, commands, wanted, device, teller)
    finally:
        port.close()
    if link.kept_bytes > MAX_KEPT_BYTES:
        teller.say(f"ended after {link.kept_bytes >> 20} MB, more than is kept in memory")
    interrupted = teller.is_stopped()
    comparison = compare(
        model, link.entries, seconds=link.now_ns * 1e-9, presses=presses, buffering_s=buffering_s(wanted.source),
        progress=teller.progress,
    )  # fmt: skip
    if presses:
        pressing.write(wanted.folder / PRESSES, presses)
    return comparison, _report(wanted, device, comparison, capture, [each.name for each in left_out], interrupted)


def chosen(device: Device, connector: Connector, wanted: Wanted) -> tuple[list[Command], list[Command]]:
    """Return the commands to send, and those that are left out because they are not declared safe."""
    own = [each for each in device.commands if (each.port or device.ports[0].name) == connector.name]
    if wanted.listens:
        return [], []
    asked = [each for each in own if each.safe or wanted.asks_all]
    return asked, [each for each in own if each not in asked]


def _announce(commands: Sequence[Command], left_out: Sequence[Command], wanted: Wanted, teller: Teller) -> None:
    """Print what will be sent, before anything is."""
    if not commands:
        teller.say("nothing is sent" + ("" if wanted.listens else ": no request of this device is declared safe"))
    else:
        teller.say("these requests are sent, several times each:")
    for each in commands:
        before, last = stages_of(each)
        requests = ", then ".join(map(text_of, [*before, last]))
        mark = "" if each.safe else "   not declared safe"
        teller.say(f"  {each.name:32}  {_short(requests.upper())}{mark}")
    if left_out:
        names = ", ".join(each.name for each in left_out)
        teller.say(f"not sent, as they may change something (--ask-all sends them): {names}")


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:79]}…"


def _talk(
    link: Link, model: Model, commands: Sequence[Command], wanted: Wanted, device: Device, teller: Teller
) -> list[pressing.Press]:
    dialogue = Dialogue(link, model, teller.progress)
    dialogue.listen(wanted.seconds)
    dialogue.ask_all(commands)
    dialogue.ask_again(lambda: late_commands(model, link.entries, buffering_s(wanted.source)))
    if wanted.press_s is None or not len(device.layout):
        return []
    return dialogue.press(device, pressing.to_press(device), wanted.press_s, teller.say)


# -- a capture ---------------------------------------------------------------------------------------------------------


def _of_capture(
    wanted: Wanted, device: Device, connector: Connector, teller: Teller
) -> tuple[Comparison, CompareReport]:
    path = Path(wanted.source)
    if path.stat().st_size > 4 * MAX_KEPT_BYTES:
        raise TactemuError(
            f"{path}: larger than {4 * MAX_KEPT_BYTES >> 20} MB; compare a part of it, one minute is ample"
        )
    recording = load(path)
    entries = recording.entries
    presses = pressing.read(wanted.presses) if wanted.presses is not None else []
    own = [each for each in device.commands if (each.port or device.ports[0].name) == connector.name]
    model = learn_model(wanted.device, _make(wanted), connector, requests_in(entries, own), teller.learning)
    seconds = entries[-1].t_ns * 1e-9 if entries else 0.0
    comparison = compare(model, entries, seconds=seconds, presses=presses, progress=teller.progress)
    return comparison, _report(wanted, device, comparison, path, [], teller.is_stopped())


def _report(
    wanted: Wanted, device: Device, comparison: Comparison, capture: Path, left_out: Sequence[str], interrupted: bool
) -> CompareReport:
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    return CompareReport(
        wanted.device, device.title, wanted.source, comparison, capture, left_out, interrupted, date,
        dict(wanted.options),
    )  # fmt: skip


def _signs(device: Device) -> dict[str, str]:
    """Return a text in the head of each file that a comparison of a device writes, by the file's name."""
    return {
        REPORT_JSON: '"tactemu":',
        REPORT_PAGE: PAGE_SIGN,
        PRESSES: pressing.HEAD,
        _measured_name(device): "by `tactemu compare`",
    }


def _measured_name(device: Device) -> str:
    return f"measured/{device.name}.toml"


def _write(report: CompareReport, comparison: Comparison, wanted: Wanted, device: Device) -> None:
    _make_folder(wanted.folder)
    report.write_json(wanted.folder / REPORT_JSON)
    report.write_html(wanted.folder / REPORT_PAGE, wanted.command)
    source = f"capture SHA-256 {report.sha256()}, {report.date}"
    _make_folder(wanted.folder / "measured")
    written(wanted.folder / _measured_name(device), measured_table(device, comparison.specimen, source))
