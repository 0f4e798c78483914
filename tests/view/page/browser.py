"""A headless Chromium that draws with the processor, and refuses every host but this one."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-gpu-compositing",  # without a graphics card each look at the panels would be drawn by shaders
]

CANVAS = "canvas[data-engine]"
"""On which three.js draws."""


def chromium() -> str:
    """Its path; a test without one is skipped."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if found is None:
        pytest.skip("no browser: apt-get install chromium")
    return found


@contextlib.contextmanager
def browsing() -> Iterator:
    """The browser."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


def opened(
    browser,
    url: str,
    wrong: list[str],
    *,
    width: int = 1000,
    height: int = 700,
    scheme: str = "light",
    scale: float = 1,
):
    """A page of a viewer's own; what goes wrong on it is added to a list."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, device_scale_factor=scale
    )
    page = context.new_page()
    ours = urlsplit(url).netloc

    def route(route):
        if urlsplit(route.request.url).netloc in (ours, ""):
            route.continue_()
        else:
            wrong.append(f"asks {route.request.url}")
            route.abort()

    context.route("**/*", route)
    page.on("console", lambda message: message.type == "error" and wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("websocket", lambda each: urlsplit(each.url).netloc == ours or wrong.append(f"asks {each.url}"))
    page.goto(url, wait_until="load", timeout=120_000)
    page.wait_for_selector(CANVAS, timeout=60_000)
    return page


def middle_of_the_scene(page) -> tuple[float, float]:
    """Where the camera looks [pixels]."""
    box = page.locator(CANVAS).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag(
    page, by: tuple[float, float], *, offset: tuple[float, float] = (0, 0), steps: int = 12, pause_ms: int = 50
) -> None:
    """What lies in the middle of the scene, or ``offset`` pixels from it, is taken somewhere; the button stays down."""
    x, y = (middle + aside for middle, aside in zip(middle_of_the_scene(page), offset))
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, steps + 1):
        page.mouse.move(x + by[0] * k / steps, y + by[1] * k / steps)
        page.wait_for_timeout(pause_ms)


def colours_drawn(page) -> int:
    """How many colours the canvas shows: one is nothing."""
    import io

    from PIL import Image

    image = Image.open(io.BytesIO(page.locator(CANVAS).screenshot()))
    return len(image.convert("RGB").resize((200, 150)).getcolors(1 << 16))
