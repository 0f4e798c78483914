"""``tactemu see``: the live page. ``python -m tactemu.cli.page FD NAME`` is the process of ``run --web``."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tactemu.base.errors import TactemuError
from tactemu.cli.datasheet import datasheet
from tactemu.cli.fitting import fitted
from tactemu.cli.signals import ended_by_signals
from tactemu.control.client import connect
from tactemu.control.endpoints import chosen
from tactemu.scene.building import make_device
from tactemu.view.page.opening import PageListener, inherited_listener

if TYPE_CHECKING:
    from tactemu.view.page.feed import PageSkin
    from tactemu.view.page.page import Page

DATASHEET_WIDTH = 56
"""Width of the lines of a datasheet in the page's right panel, and on a phone [characters]."""

_RETRY_S = 0.5
"""The time after which the page looks for the next run of its name."""
_NICE = 5
"""The nice value of the page's process, so that drawing delays no emulator."""


def show_runs(name: str, listener: PageListener) -> None:
    """Show the emulator of that name until Ctrl-C; after its end, the next one of that name."""
    print(f"see {name}: {listener.url}", flush=True)
    ended = threading.Event()
    with ended_by_signals(ended.set):
        page = _page(listener, name)
        threading.Thread(target=_show_all, args=(page, name, ended), daemon=True).start()
        ended.wait()
        page.close()


def _show_all(page: Page, name: str, ended: threading.Event) -> None:
    """Show one run of that name after the other."""
    while not ended.is_set():
        with contextlib.suppress(TactemuError):
            page.show(lambda: connect(name))
        ended.wait(_RETRY_S)


def _page(listener: PageListener, name: str) -> Page:
    os.sched_setscheduler(
        0, os.SCHED_OTHER, os.sched_param(0)
    )  # undo the real-time priority inherited from a run with --preempt
    os.nice(_NICE)
    out, sys.stdout = sys.stdout, open(os.devnull, "w", encoding="utf-8")  # viser prints to it
    from tactemu.view.page.guard import Gate
    from tactemu.view.page.page import Page

    def say(text: str) -> None:
        print(f"tactemu see: {text}", file=sys.stderr, flush=True)

    try:
        gate = Gate(listener.listener, listener.hosts, listener.token, f"tactemu {name}", say)
        return Page(gate, f"tactemu {name}", _datasheet)
    except BaseException:
        sys.stdout = out
        raise


def _datasheet(skin: PageSkin) -> Sequence[str]:
    """Return the datasheet of a skin's device, made with the options of the run."""
    target = skin.about.get("target")
    try:
        if target is None:
            raise TactemuError("the emulator does not name it")
        device = make_device(target, dict(skin.about.get("options", {})))
        return list(fitted(datasheet(skin.described.device, device, DATASHEET_WIDTH), DATASHEET_WIDTH))
    except (TactemuError, OSError) as error:
        return [skin.described.title, "", f"its device cannot be made here: {error}"]


def main() -> int:
    """Show the run that has started this process until it ends, and return the exit code."""
    number, name = int(sys.argv[1]), sys.argv[2]
    listener = inherited_listener(number, sys.stdin.read())
    try:
        with ended_by_signals():
            page = _page(listener, name)
            page.show(lambda: connect(name))
            time.sleep(_RETRY_S)
            page.close()
    except TactemuError as error:
        time.sleep(_RETRY_S)  # a run that ends closes its connections before it gives up its name
        if not _runs(name):  # it ended while the page started
            return 0
        print(f"tactemu: the page: {error}", file=sys.stderr)
        return 1
    return 0


def _runs(name: str) -> bool:
    """Return True if there is an emulator of that name."""
    try:
        chosen(name)
    except TactemuError:
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
