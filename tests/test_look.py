"""Real output in a browser: no label lies on another, nothing is cut, all can be read, at three widths, light and dark.

``LOOK=FOLDER`` keeps a picture of each screen.
"""

import io
import os
import re
from pathlib import Path

import pytest

from tactemu.base import style
from tests.cli.command import ROOT, here
from tests.look import mistakes
from tests.view.page.browser import CANVAS, browsing

pytest.importorskip("matplotlib", reason="comes with the extra plots")
pytestmark = [pytest.mark.timeout(180)]
PICTURES = ROOT / "docs" / "pictures"
RECORDING = ROOT / "tests" / "data" / "real" / "eflesh" / "normal_1.csv.gz"
MAX_DOCS_BYTES = 8_000_000
HOOK = """
import sys
sys.path.insert(0, {site!r})
from hooks import *
import hooks

def on_files(files, config):
    for file in list(hooks.on_files(files, config)):
        if file.src_uri.startswith(("devices/", "reference/")):
            files.remove(file)
    return files
"""


@pytest.fixture(scope="module")
def browser():
    with browsing() as each:
        yield each


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """A card of a real run, a plot of a log, and the report of a fit of a real sensor."""
    folder = tmp_path_factory.mktemp("look")
    body = re.findall(r"<body[^>]*>(.*)</body>", (PICTURES / "card.html").read_text(), re.DOTALL)[0]
    (folder / "card.html").write_text(style.page("card", [body]))
    log = str(folder / "t.mcap")
    assert not here(
        "run", "anyskin", *"--clock virtual --port memory: --seconds 3 --plain --truth".split(), log
    ).returncode
    for suffix in ("html", "svg"):
        assert not here("plot", log, "--to", str(folder / f"plot.{suffix}")).returncode
    (folder / "image.html").write_text(
        style.page("plot", [f"<figure style='background: #fff'>{_inside(folder / 'plot.svg')}</figure>"])
    )
    columns = "--columns t=t_sensor_s,z=z_mm,mass=mass_g,field=b0x:b4z --unit z=mm,mass=g,field=uT".split()
    fitted = ["--sensor", "anyskin", *columns, "--out", str(folder / "fit.toml")]
    assert not here("fit", str(RECORDING), *fitted).returncode
    return {each.stem: each for each in folder.glob("*.html")}


def _inside(svg: Path) -> str:
    text = svg.read_text()
    return text[text.index("<svg") :]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The front page and that of a benchmark, as the site has them."""
    pytest.importorskip("mkdocs", reason="comes with the extra docs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    (folder / "hook.py").write_text(HOOK.format(site=str(ROOT / "docs" / "site")))
    config = load_config(
        str(ROOT / "mkdocs.yml"), docs_dir=str(ROOT / "docs"), site_dir=str(folder / "site"), plugins=["offline"],
        hooks=[str(folder / "hook.py")], nav=["index.md", "accuracy.md"],
        exclude_docs="site/\n/*.md\n!/accuracy.md\n!/index.md\n",
    )  # fmt: skip
    build(config)
    return folder / "site"


def kept() -> Path | None:
    folder = os.environ.get("LOOK")
    return Path(folder) if folder else None


@pytest.mark.parametrize("name", ["card", "plot", "image", "fit"])
def test_a_report_is_whole_on_every_screen(browser, pages, name):
    assert not mistakes(browser, pages[name], folder=kept())


@pytest.mark.parametrize("name", ["index", "accuracy"])
def test_a_page_of_the_site_is_whole_on_every_screen(browser, site, name):
    assert not mistakes(browser, site / f"{name}.html", without="live.html", folder=kept())


def test_what_is_shown_side_by_side_is_stacked_on_a_phone(browser, site):
    page = browser.new_page()
    page.route("**/live.html*", lambda route: route.abort())
    page.goto((site / "index.html").as_uri())
    for width, columns in ((1440, 3), (1000, 2), (400, 1)):
        page.set_viewport_size({"width": width, "height": 900})
        boxes = [each.bounding_box() for each in page.locator(".front > figure").all()]
        assert len(boxes) == 3 and len({round(box["x"]) for box in boxes}) == columns
        below = [(a, b) for a in boxes for b in boxes if a is not b and a["x"] == b["x"] and a["y"] < b["y"]]
        assert all(a["y"] + a["height"] <= b["y"] + 1 for a, b in below)
    page.close()


@pytest.mark.nightly
def test_the_recording_plays_and_asks_no_other_host(browser, site):
    from PIL import Image

    page, asked = browser.new_page(), []
    page.on("request", lambda request: request.url.startswith(("file:", "data:", "blob:")) or asked.append(request.url))
    page.goto((site / "index.html").as_uri())
    canvas = page.frame_locator(".front iframe").locator(CANVAS)
    canvas.wait_for(timeout=60_000)
    shots = []
    while len(shots) < 2 or shots[-1] == shots[0]:
        page.wait_for_timeout(500)
        shots.append(canvas.screenshot())
    assert len(Image.open(io.BytesIO(shots[-1])).convert("RGB").getcolors(1 << 20)) > 50 and not asked
    page.close()


def test_all_of_docs_is_small():
    assert (
        sum(path.stat().st_size for path in (ROOT / "docs").rglob("*") if "__pycache__" not in path.parts)
        < MAX_DOCS_BYTES
    )
