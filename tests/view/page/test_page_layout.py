"""The page's panels at three widths, light and dark: nothing overlaps, nothing is cut, all text can be read."""

from pathlib import Path

import pytest

import tactemu as tt
from tests.control.conftest import runtime_folder  # noqa: F401
from tests.view.page.browser import CANVAS, browsing, opened
from tests.view.page.screenshots import IS_DRAWN
from tests.view.page.test_page import Seen

pytest.importorskip("viser", reason="the page comes with the extra web")
pytestmark = [pytest.mark.timeout(180)]

LAYOUT = (Path(__file__).parent / "page_layout.js").read_text().split("\n", 2)[2]
SIZES = {1440: 900, 1000: 700, 400: 800}
SCHEMES = ("light", "dark")
DEVICES = ("anyskin", "flexitac", "inspire_rh56dftp", "bota_sensone", "icub_skin", "sensing_tex_mat")
"""A skin of few taxels with four channels, sheets, hands with many patches, a CAN device, a force torque sensor."""
SET_SCHEME = """scheme => {
  document.documentElement.setAttribute("data-mantine-color-scheme", scheme);
  return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
}"""
FIRST_SCREEN = """scene => {
  const shown = e => {
    const box = e.getBoundingClientRect();
    return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2) === e;
  };
  return {
    scene: document.querySelector(scene).getBoundingClientRect().height / innerHeight,
    taxels: [...document.querySelectorAll(".tt-patch img, .tt-ramp")].filter(shown).length,
  };
}"""
"""The share of the window's height that the scene has, and how many pictures and colour bars of taxels lie on top."""
MAX_LOOKS = 20
"""How often the page is looked at until it stands still: sections glide open, notifications come in."""
TABS = ("Curves", "Numbers", "Statistics", "Datasheet")


def look_at_all(browser, url: str, width: int, wrong: list[str]) -> list[str]:
    """What is wrong with every tab of the page, light and dark."""
    page = opened(browser, url, wrong, width=width, height=SIZES[width])
    page.locator(".tt-patch img, .tt-numbers, .tt p").first.wait_for(timeout=60_000)
    found = look_at_first_screen(page, width)
    if width < 576:
        page.get_by_role("button", name="Expand panel Wire").click()
    if width == 1000:
        page.keyboard.press("p")
    else:
        page.get_by_role("button", name="Press taxel").click()
    page.locator(".mantine-Notification-root", has_text="Pressed taxel").wait_for(timeout=60_000)
    page.locator(".tt-frame").first.wait_for(timeout=60_000)
    found += look(page, width, "Pictures, Wire")
    for tab in TABS:
        page.get_by_role("tab", name=tab).click()
        if tab == "Curves":
            page.get_by_role("button", name="Add taxel").click()
            page.locator(".tt-legend").first.wait_for(timeout=60_000)
        found += look(page, width, tab)
    page.context.close()
    return found


def look_at_first_screen(page, width: int) -> list[str]:
    """What is wrong with what a viewer sees who has neither clicked nor scrolled, in each colour scheme."""
    page.wait_for_function(IS_DRAWN, timeout=60_000)
    found = look(page, width, "first screen")
    seen = page.evaluate(FIRST_SCREEN, CANVAS)
    if seen["scene"] < 1 / 3:
        found.append(f"{width}: the scene has only {seen['scene']:.0%} of the height")
    if seen["taxels"] < 1:
        found.append(f"{width}: no picture of taxels is on the first screen")
    return found


def look(page, width: int, where: str) -> list[str]:
    """What is wrong with the page as it is now, in each colour scheme."""
    found = []
    for scheme in SCHEMES:
        page.evaluate(SET_SCHEME, scheme)
        seen = page.evaluate(LAYOUT)
        for _ in range(MAX_LOOKS):
            if not seen["wrong"]:
                break
            page.wait_for_timeout(250)
            seen = page.evaluate(LAYOUT)
        assert seen["leaves"] > 20, f"{width} {scheme} {where}: the panels are empty"
        found += [f"{width} {scheme} {where}: {each}" for each in seen["wrong"]]
    return found


def look_at_device(device: str) -> None:
    """All panels of a device that is touched, while a fault is in force."""
    wrong: list[str] = []
    with tt.serve(device, "memory:", name="layout", adjustable=["noise", "dead"]) as dev:
        page = Seen("layout")
        dev.fault("flip 20%")
        dev.press(depth=1e-3, taxel=0, wait=True)
        with browsing() as browser:
            found = [each for width in SIZES for each in look_at_all(browser, page.url, width, wrong)]
        page.end()
    assert not found, "\n".join(found)
    assert not wrong


def test_panels_are_whole_and_can_be_read(runtime_folder):  # noqa: F811
    look_at_device("linker_hand_l6")


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("device", DEVICES)
def test_panels_of_many_devices_are_whole(device, runtime_folder):  # noqa: F811
    look_at_device(device)
