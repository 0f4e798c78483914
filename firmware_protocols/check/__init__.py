"""The contract's judge: what can be told of a device from its declarations, its worked examples, and by using it.

It only calls the device, as a runner would; no port is opened and no clock is read by what it calls. What it cannot
know is whether the declarations are true of the hardware (scale, above all): the unmodified driver judges that.

>>> from firmware_protocols.check import check
>>> print("\\n".join(check("anyskin").lines()))                        # doctest: +SKIP
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from firmware_protocols import registry
from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check import converter, declarations, examples, memory, order, requests, restarts
from firmware_protocols.check.host import Subject
from firmware_protocols.check.report import Fault, Report, distinct

__all__ = ["Fault", "Report", "check"]

FUZZ = 1000


def check(target: str, options: Mapping[str, Any] | None = None, *, fuzz: int = FUZZ) -> Report:
    """Return all that is wrong with a device, worst first, and what no example pins.

    Args:
        target: a registered name, or ``path/to/file.py:Class``.
        options: of the device.
        fuzz: how many spoiled requests are tried.

    Raises:
        LookupError: no such device.
        ValueError: an option that it does not take.
    """
    start = time.perf_counter()
    name = target.rpartition(":")[2] if ".py:" in target else target
    try:
        subject = Subject(target, registry.device_class(target), dict(options or {}))
        name = getattr(subject.cls, "name", name)
        baseline = restarts.Baseline(subject)
        _ = subject.commands
    except (LookupError, ValueError) as error:
        if isinstance(error, LookupError) or not _own_fault(error, target):
            raise
        return Report(name, (_at_import(target, error),), seconds=time.perf_counter() - start)
    except AuthorError as error:
        return Report(name, (Fault.of("power-up", error),), seconds=time.perf_counter() - start)
    except Exception as error:
        return Report(name, (_at_import(target, error),), seconds=time.perf_counter() - start)
    found, unpinned, count = _judged(subject, baseline, fuzz)
    return Report(name, distinct(found), tuple(unpinned), count, time.perf_counter() - start)


def _judged(subject: Subject, baseline: restarts.Baseline, fuzz: int) -> tuple[list[Fault], list[str], int]:
    found = _tried(subject, "declarations", lambda: declarations.faults(subject))
    state = _tried(subject, "restart", lambda: restarts.faults(baseline))  # first: before others leave something behind
    wrong = _tried(subject, "converter", lambda: converter.faults(subject))
    judged, unpinned, count = examples.judged(subject)
    found += wrong + judged + state
    # A device that already has faults is not saved: the report is there at once, and the rest may follow from them.
    elsewhere, unsaved = (None, []) if found else restarts.saved_elsewhere(subject)
    found += _tried(subject, "commands", lambda: requests.faults(subject, fuzz))
    found += _tried(subject, "registers", lambda: memory.faults(subject))
    if not any(fault.part == "converter" for fault in wrong) and not baseline.why:
        found += _tried(subject, "order", lambda: order.faults(subject))
    found += unsaved + (_tried(subject, "restart", elsewhere.faults) if elsewhere else [])
    return found, [*unpinned, *([] if judged else order.wordless(subject))], count


def _tried(subject: Subject, part: str, check: Callable[[], Iterable[Fault]]) -> list[Fault]:
    """Return faults of one part. A device that breaks the check itself has broken the contract somewhere: say where."""
    found: list[Fault] = []
    try:
        found.extend(check())
    except AuthorError as error:
        found.append(Fault.of(part, error))
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno}: {at.line})"
        found.append(Fault(part, text, *source_line(subject.cls)))
    return found


def _own_fault(error: Exception, target: str) -> bool:
    """Whether the device's file raised it, when it was imported."""
    file = Path(target.rpartition(":")[0]).resolve()
    return any(Path(call.filename).resolve() == file for call in traceback.extract_tb(error.__traceback__))


def _at_import(target: str, error: Exception) -> Fault:
    """Return a file that does not import, or holds no device."""
    calls = traceback.extract_tb(error.__traceback__)
    file = target.rpartition(":")[0]
    own = next(
        (call for call in reversed(calls) if file and Path(call.filename).resolve() == Path(file).resolve()), None
    )
    if isinstance(error, SyntaxError):
        return Fault("import", f"{error.msg}: {(error.text or '').strip()}", error.filename or file, error.lineno or 0)
    return Fault(
        "import", f"{type(error).__name__}: {error}", own.filename if own else file, (own.lineno or 0) if own else 0
    )
