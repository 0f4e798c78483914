"""The site as people see it: every page in a headless Chromium, with all other hosts refused.

``python -m tests.site [FOLDER]``, nightly: 1440 and 400 pixels wide, light and dark; all pages on two of these screens,
some on all. A page fails that asks another host for anything, that has an error in the console, or that is wider than
the screen. Pictures of some pages go to FOLDER. Needs ``mkdocs build --strict`` before it, Chromium (``apt-get install
chromium``) and the extra ``docs``.
"""

import contextlib
import functools
import http.server
import os
import shutil
import sys
import threading
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Browser, sync_playwright

SITE = Path(__file__).parents[1] / "build" / "site"
WIDTHS, SCHEMES = (1440, 400), ("light", "dark")
SHOWN = ("index.html", "choosing.html", "devices/anyskin.html", "reference/conventions.html", "tutorial.html")


def served() -> http.server.ThreadingHTTPServer:
    """The site on a port of this machine."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def copyfile(self, source, outputfile):
            with contextlib.suppress(ConnectionError):  # the browser went on to the next page
                super().copyfile(source, outputfile)

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=SITE))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def look(browser: Browser, base: str, width: int, scheme: str, pages: list[str], folder: Path | None) -> list[str]:
    """What is wrong with the pages on such a screen."""
    wrong: list[str] = []
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    here = ""

    def route(route):
        if urlsplit(route.request.url).netloc == urlsplit(base).netloc or route.request.url.startswith("data:"):
            route.continue_()
        else:
            wrong.append(f"{here}: asks {route.request.url}")
            route.abort()

    context.route("**/*", route)
    page.on("console", lambda message: message.type == "error" and wrong.append(f"{here}: {message.text}"))
    page.on("pageerror", lambda error: wrong.append(f"{here}: {error}"))
    for here in pages:
        page.goto(f"{base}/{here}", wait_until="load")
        if page.evaluate("document.documentElement.scrollWidth") > width:
            wrong.append(f"{here}: wider than {width} pixels")
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        if (sum(map(int, background[4:-1].split(",")[:3])) < 384) != (scheme == "dark"):
            wrong.append(f"{here}: {background} is not {scheme}")
        if here == "choosing.html":
            page.wait_for_selector("#trade .scatterlayer .point", timeout=10_000)
        if folder and here in SHOWN:
            page.screenshot(path=folder / f"{here.replace('/', '-')}-{width}-{scheme}.png")
    context.close()
    return wrong


def main() -> int:
    """Print what is wrong; 1 where something is."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    pages = sorted(str(path.relative_to(SITE)) for path in SITE.rglob("*.html"))
    server, wrong = served(), []
    base = f"http://127.0.0.1:{server.server_address[1]}"
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        for width in WIDTHS:
            for scheme in SCHEMES:
                whole = (width, scheme) in ((1440, "light"), (400, "dark"))
                wrong += look(browser, base, width, scheme, pages if whole else [*SHOWN], folder)
                print(f"{width} pixels, {scheme}: seen", flush=True)
        browser.close()
    print(*wrong, sep="\n")
    print(f"{len(pages)} pages, {len(WIDTHS) * len(SCHEMES)} screens, {len(wrong)} faults")
    return int(bool(wrong) or not pages)


if __name__ == "__main__":
    sys.exit(main())
