"""Screenshots of the live page, to be looked at: ``python -m tests.view.page.screenshots FOLDER [SCENE ...]``.

A sheet and a hand that a ball touches, and a grasp, each at several widths, light and dark.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import tactemu as tt
from firmware_protocols import CanFrame
from tests.view.page.browser import browsing, opened

SIZES = {"wide": (1440, 900), "narrow": (1000, 700), "phone": (400, 800)}
SCHEMES = ("light", "dark")
ROOT = Path(__file__).parents[3]


def press_middle(device) -> None:
    """Press a taxel for as long as pictures are taken."""
    device.press(depth=1.0e-3, dwell=600, wait=False)


def grasp(device) -> None:
    """Close thumb and index of a LinkerHand L6 around a ball."""
    wire = device.emulator.channels[0].wire.transport.driver
    for data in ((0x05, *[128] * 6), (0x02, 255, 255, 25, 255, 255, 255), (0x01, 32, *[255] * 5)):
        wire.write(CanFrame(arbitration_id=0x28, data=bytes(data)))
        time.sleep(0.1)
    time.sleep(1.5)
    wire.write(CanFrame(arbitration_id=0x28, data=bytes((0x01, 32, 255, 0, 255, 255, 255))))
    time.sleep(3.0)


SCENES: dict[str, tuple[str, Callable]] = {
    "sheet": ("xela_uskin", press_middle),
    "skin": ("anyskin", press_middle),
    "hand": ("inspire_rh56dftp", press_middle),
    "tips": ("orca_touch", press_middle),
    "grasp": (str(ROOT / "examples" / "hands" / "linker_l6.toml"), grasp),
}


@contextlib.contextmanager
def shown(what: str, name: str, begin: Callable | None = None) -> Iterator[tuple[object, str]]:
    """Serve a device or a scene, and yield it with the link of its page."""
    with tt.serve(what, "memory:", name=name) as device:
        command = [sys.executable, "-m", "tactemu", "see", name, "--web-port", "0"]
        page = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert page.stdout is not None
            url = page.stdout.readline().split()[-1]
            if begin is not None:
                begin(device)
            yield device, url
        finally:
            page.terminate()
            page.wait()


def main() -> None:
    """Take the pictures."""
    folder, *wanted = sys.argv[1:] or ["screenshots"]
    Path(folder).mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.mkdtemp())
    with browsing() as browser:
        for name in wanted or SCENES:
            scene, _, only = name.partition(":")
            what, begin = SCENES[scene]
            with shown(what, scene, begin) as (_, url):
                for size, (width, height) in SIZES.items():
                    for scheme in SCHEMES:
                        label = f"{scene}-{size}-{scheme}"
                        if only and only not in label:
                            continue
                        wrong: list[str] = []
                        page = opened(browser, url, wrong, width=width, height=height, scheme=scheme)
                        page.add_style_tag(content=".mantine-Notification-root { display: none; }")
                        page.wait_for_timeout(2500)
                        page.screenshot(path=Path(folder) / f"{label}.png")
                        page.context.close()
                        print(label, *wrong, flush=True)


if __name__ == "__main__":
    main()
