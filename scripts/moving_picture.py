"""Make the moving picture of README: the live page beside the terminal of an unmodified driver, from one run.

``scripts/moving_picture.py [FILE]`` serves AnySkin, reads it with the ``anyskin`` package, presses it twice, and takes
pictures of the page in a headless Chromium. It needs the extras ``web`` and ``drivers``, Chromium, and a quiet machine.
"""

import io
import json
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

import tactemu as tt

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
from tests.view.page.browser import CANVAS, browsing, opened

PICTURE = ROOT / "docs" / "pictures" / "live.gif"
WIDTH, HEIGHT, COLUMN = 440, 380, 420
SECONDS, INTERVAL_S = 6.0, 0.15
CODE = """$ cat read.py
from anyskin.sensor import AnySkinBase
skin = AnySkinBase(num_mags=5, port="/tmp/skin")
while True:
    t, values = skin.get_sample()
    print(values[2::3])    # Bz of five chips [µT]
$ python read.py
"""
DRIVER = """
import contextlib, json, sys
from anyskin.sensor import AnySkinBase
with contextlib.redirect_stdout(sys.stderr):
    skin = AnySkinBase(num_mags=5, port=sys.argv[1], temp_filtered=True)
while True:
    print(json.dumps(list(map(float, skin.get_sample()[1][2::3]))), flush=True)
"""
DARK, PALE, CODE_COLOUR = (24, 26, 27), (222, 226, 230), (116, 192, 252)


def listen(process: subprocess.Popen[str], lines: deque[str]) -> None:
    """Keep the last lines of the driver, one in eight."""
    assert process.stdout is not None
    for number, line in enumerate(process.stdout):
        if number % 8 == 0:
            lines.append(" ".join(f"{value:8.2f}" for value in json.loads(line)))


def terminal(lines: list[str]) -> Image.Image:
    """Return the picture of a terminal."""
    import matplotlib  # its fonts

    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    font = ImageFont.truetype(str(fonts / "DejaVuSansMono.ttf"), 13)
    image = Image.new("RGB", (COLUMN, HEIGHT), DARK)
    draw = ImageDraw.Draw(image)
    code = CODE.splitlines()
    for row, line in enumerate([*code, *lines]):
        draw.text((14, 14 + 18 * row), line, font=font, fill=CODE_COLOUR if row < len(code) else PALE)
    return image


def pictures(url: str, lines: deque[str], press) -> list[tuple[float, Image.Image]]:
    """Return pictures of the page and the terminal with their times [s], while it is pressed twice."""
    found: list[tuple[float, Image.Image]] = []
    with browsing() as browser:
        page = opened(browser, url, [], width=940, height=460, scheme="dark")
        page.add_style_tag(content=f"* {{visibility: hidden}} {CANVAS} {{visibility: visible}}")
        page.wait_for_timeout(3000)
        box = page.locator(CANVAS).bounding_box()
        clip = {
            "x": box["x"] + (box["width"] - WIDTH) / 2, "y": box["y"] + (box["height"] - HEIGHT) / 2,
            "width": WIDTH, "height": HEIGHT,
        }  # fmt: skip
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        for _ in range(7):
            page.mouse.wheel(0, -120)
            page.wait_for_timeout(200)
        threading.Thread(target=press, daemon=True).start()
        begin = time.monotonic()
        while (now := time.monotonic() - begin) < SECONDS:
            shot = Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")
            whole = Image.new("RGB", (WIDTH + COLUMN, HEIGHT), DARK)
            whole.paste(shot, (0, 0))
            whole.paste(terminal(list(lines)), (WIDTH, 0))
            found.append((now, whole))
            page.wait_for_timeout(max(0.0, begin + now + INTERVAL_S - time.monotonic()) * 1000)
    return found


def main() -> None:
    """Make the picture."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE
    lines: deque[str] = deque(maxlen=12)
    with tt.serve("anyskin", name="moving-picture") as dev:
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, dev.port], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        see = [sys.executable, "-m", "tactemu", "see", "moving-picture", "--web-port", "0"]
        seen = subprocess.Popen(see, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            dev.wait_for_driver()
            threading.Thread(target=listen, args=(driver, lines), daemon=True).start()
            assert seen.stdout is not None
            url = seen.stdout.readline().split()[-1]
            shots = pictures(
                url, lines, lambda: [dev.press(depth=1.5e-3, dwell=0.8, taxel=taxel, speed=0.003) for taxel in (0, 3)]
            )
        finally:
            for process in (driver, seen):
                process.terminate()
                process.wait()
    times, images = zip(*shots)
    every = Image.new("RGB", (WIDTH + COLUMN, HEIGHT * len(images)))
    for k, image in enumerate(images):
        every.paste(image, (0, HEIGHT * k))
    palette = every.quantize(96, Image.Quantize.MAXCOVERAGE)
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [round(1000 * (then - now)) for now, then in zip(times, [*times[1:], times[-1] + 1])]
    file.parent.mkdir(parents=True, exist_ok=True)
    small[0].save(file, save_all=True, append_images=small[1:], duration=durations, loop=0, optimize=True)
    print(f"{file}: {file.stat().st_size} bytes, {len(shots)} pictures")


if __name__ == "__main__":
    main()
