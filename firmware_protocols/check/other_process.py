"""The check of snapshots: a device that another process restores sends the same bytes as one that was never saved."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator

from firmware_protocols import registry, state_file
from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check.host import STEP_NS, Host, Subject, exercise
from firmware_protocols.check.report import Fault
from firmware_protocols.frames import text_of
from firmware_protocols.state import NotPlain

PROCESS_TIMEOUT_S = 30
"""The time after which the other process must have ended."""


class OtherProcess:
    """A device saved in the middle of its use, which goes on in a new process as well as here."""

    def __init__(self, subject: Subject):
        self.subject = subject
        self.host = Host(subject.make())
        exercise(self.host, subject, 3, rounds=1)
        for request, port in subject.requests()[:1]:
            if isinstance(request, bytes):
                self.host.send(request[: len(request) // 2], port)
        saved = state_file.to_bytes(self.host.device.snapshot())
        header = {"target": subject.target, "options": dict(subject.options), "t_ns": self.host.t_ns}
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        self.process = subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import main; main()"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": paths},
        )  # fmt: skip
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(header).encode() + b"\n" + saved)
        self.process.stdin.close()
        self.process.stdin = None

    def faults(self) -> Iterator[Fault]:
        """Wait for the process, and yield a fault if it failed or sent other frames."""
        file, line = source_line(self.subject.cls, "__init__")
        here = _continued(self.host, self.subject)
        out, err = self.process.communicate(timeout=PROCESS_TIMEOUT_S)
        if self.process.returncode:
            last = err.decode(errors="replace").strip().splitlines()[-1:]
            yield Fault("restart", f"a snapshot cannot be restored in another process: {' '.join(last)}", file, line)
        elif here != (there := json.loads(out)):
            at = next((k for k, (a, b) in enumerate(zip(here, there)) if a != b), min(len(here), len(there)))
            text = f"restored from a snapshot in another process it sends other bytes, from frame {at} on"
            yield Fault("restart", text, file, line)


def start(subject: Subject) -> tuple[OtherProcess | None, list[Fault]]:
    """Start the other process and return it; or no process, and the fault that prevents it."""
    try:
        return OtherProcess(subject), []
    except AuthorError as error:
        return None, [Fault.of("restart", error)]
    except NotPlain as error:
        return None, [Fault("restart", str(error), *source_line(subject.cls, "__init__"))]


def main() -> None:
    """Restore the device in a snapshot from stdin, use it, and print its frames as JSON.

    Stdin is a line of JSON (target, options, time), then the bytes of :func:`firmware_protocols.state_file.to_bytes`.
    """
    head, _, saved = sys.stdin.buffer.read().partition(b"\n")
    header = json.loads(head)
    subject = Subject(header["target"], registry.device_class(header["target"]), header["options"])
    host = Host(subject.build())
    host.device.restore(state_file.read(saved)[0])
    host.t_ns = header["t_ns"]
    sys.stdout.write(json.dumps(_continued(host, subject)))


def _continued(host: Host, subject: Subject) -> list[str]:
    """Use the device further, and return its frames as text."""
    host.wait(STEP_NS)
    return [text_of(frame) for frame in exercise(host, subject, 4, rounds=1)]
