"""Screenshots of the live page, to be looked at: ``python -m tests.view.page.screenshots [FOLDER [LABEL ...]]``.

Sheets and hands that a ball touches, and a grasp, each at several widths, light and dark. A label is the beginning of
``SCENE-SIZE-SCHEME``, or ``all``; without one there are the four of :data:`USUAL`. Without a folder these are written
for docs/live-page.md.
"""

import argparse
import contextlib
import io
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from pathlib import Path

from PIL import Image

import tactemu as tt
from firmware_protocols import CanFrame, WireFrame
from tactemu.base.errors import no_such
from tests.view.page.browser import CANVAS, browsing, opened

SIZES = {"wide": (1440, 900), "narrow": (1000, 700), "phone": (400, 800)}
SCHEMES = ("light", "dark")
ROOT = Path(__file__).parents[3]
PICTURES = ROOT / "docs" / "pictures"
USUAL = ("hand-wide-light", "sheet-wide-dark", "grasp-narrow-light", "skin-phone-light")
"""The pictures of docs/live-page.md, which each run of the CI takes, too."""
FINE = 2
"""The factor by which pictures for the documentation are drawn larger than they are shown."""
IS_DRAWN = f"""() => {{
  const look = getComputedStyle(document.querySelector("{CANVAS}").parentElement, "::after");
  return look.backgroundImage !== "none";
}}"""
"""Whether the legend of the scene is there."""


def driver_end(device):
    """Return the driver's end of a device's port in memory."""
    return device.emulator.channels[0].wire.transport.driver


def press_middle(device) -> None:
    """Press a taxel for as long as pictures are taken."""
    device.press(depth=1.0e-3, dwell=600, wait=False)


def start_and_press(device) -> None:
    """Start the stream of a uSkin, and press a taxel."""
    driver_end(device).write(CanFrame(arbitration_id=0x201, data=b"\x07\x00"))
    press_middle(device)


def read_port(device, requests: Sequence[WireFrame]) -> None:
    """Read the port as a driver does, until the device stops: send the requests in turn, ten a second."""
    for request in cycle(requests or (None,)):
        if not device.running:
            return
        if request is not None:
            driver_end(device).write(request)
        time.sleep(0.1)
        driver_end(device).read()


def grasp(device) -> None:
    """Close thumb and index of a LinkerHand L6 around a ball."""
    wire = driver_end(device)
    for data in ((0x05, *[128] * 6), (0x02, 255, 255, 25, 255, 255, 255), (0x01, 32, *[255] * 5)):
        wire.write(CanFrame(arbitration_id=0x28, data=bytes(data)))
        time.sleep(0.1)
    time.sleep(1.5)
    wire.write(CanFrame(arbitration_id=0x28, data=bytes((0x01, 32, 255, 0, 255, 255, 255))))
    time.sleep(3.0)


MIDDLE_PAD = bytes.fromhex("01 03 0f 6e 00 50 27 3f")
"""A Modbus request for the taxels of the middle finger's pad of an RH56DFTP."""
THUMB_AND_INDEX = [CanFrame(arbitration_id=0x28, data=bytes((finger, 0xC6))) for finger in (0xB1, 0xB2)]
"""Requests for the matrices of thumb and index of a LinkerHand L6."""
SCENES: dict[str, tuple[str, Callable, Sequence[WireFrame]]] = {
    "sheet": ("xela_uskin", start_and_press, ()),
    "skin": ("anyskin", press_middle, ()),
    "hand": ("inspire_rh56dftp", press_middle, [MIDDLE_PAD]),
    "tips": ("orca_touch", press_middle, ()),
    "grasp": (str(ROOT / "examples" / "hands" / "linker_l6.toml"), grasp, THUMB_AND_INDEX),
}
"""The scenes: what is served, what moves it, and the requests of the driver that reads it."""
LABELS = [f"{scene}-{size}-{scheme}" for scene in SCENES for size in SIZES for scheme in SCHEMES]


@contextlib.contextmanager
def shown(
    what: str, name: str, begin: Callable | None = None, requests: Sequence[WireFrame] = ()
) -> Iterator[tuple[object, str]]:
    """Serve a device or a scene to a driver that polls it, and yield it with the link of its page."""
    with tt.serve(what, "memory:", name=name) as device:
        command = [sys.executable, "-m", "tactemu", "see", name, "--web-port", "0"]
        page = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert page.stdout is not None
            url = page.stdout.readline().split()[-1]
            if begin is not None:
                begin(device)
            threading.Thread(target=read_port, args=(device, requests), daemon=True).start()
            yield device, url
        finally:
            page.terminate()
            page.wait()


def take(browser, url: str, label: str, scale: float = 1) -> tuple[bytes, list[str]]:
    """Take a picture of a page as PNG, once its skin is drawn; also return what went wrong."""
    _, size, scheme = label.split("-")
    width, height = SIZES[size]
    wrong: list[str] = []
    page = opened(browser, url, wrong, width=width, height=height, scheme=scheme, scale=scale)
    page.add_style_tag(content=".mantine-Notification-root { display: none; }")
    page.wait_for_function(IS_DRAWN, timeout=60_000)
    page.wait_for_timeout(2500)
    picture = page.screenshot()
    page.context.close()
    return picture, wrong


def reduced(picture: bytes) -> bytes:
    """Return a picture of :data:`FINE` times its size as WebP: a browser without a GPU draws jagged edges."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    out = io.BytesIO()
    image.resize((image.width // FINE, image.height // FINE), Image.Resampling.LANCZOS).save(out, "WebP", quality=82)
    return out.getvalue()


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.view.page.screenshots", description="Take screenshots of the live page."
    )
    parser.add_argument("folder", metavar="FOLDER", nargs="?", type=Path, help="default: that of docs/live-page.md")
    about = f"beginnings of SCENE-SIZE-SCHEME (scenes: {', '.join(SCENES)}), or all; default: {', '.join(USUAL)}"
    parser.add_argument("labels", metavar="LABEL", nargs="*", help=about)
    given = parser.parse_args()
    is_for_docs, folder = given.folder is None, given.folder or PICTURES
    wanted = LABELS if given.labels == ["all"] else given.labels or list(USUAL)
    if unknown := [each for each in wanted if not any(label.startswith(each) for label in LABELS)]:
        parser.error(no_such("label", unknown[0], LABELS))
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.mkdtemp())
    with browsing() as browser:
        for name, (what, begin, requests) in SCENES.items():
            labels = [each for each in LABELS if each.startswith(f"{name}-") and each.startswith(tuple(wanted))]
            if not labels:
                continue
            with shown(what, name, begin, requests) as (_, url):
                for label in labels:
                    picture, wrong = take(browser, url, label, FINE if is_for_docs else 1)
                    if is_for_docs:
                        (folder / f"page-{name}.webp").write_bytes(reduced(picture))
                    else:
                        (folder / f"{label}.png").write_bytes(picture)
                    print(label, *wrong, flush=True)


if __name__ == "__main__":
    main()
