"""The scene of the page: the skin fills the free part of the canvas, at three widths, light and dark."""

import io

import numpy as np
import pytest

from firmware_protocols import registry
from tactemu.base.style import THEMES, rgb
from tests.control.conftest import runtime_folder  # noqa: F401
from tests.view.page.browser import CANVAS, browsing, opened

pytest.importorskip("viser", reason="the page comes with the extra web")

from tactemu.view.page import camera, legend
from tactemu.view.page.hands import finger_of, hand
from tactemu.view.page.shapes import capsule, carrier, hull, rounded

pytestmark = [pytest.mark.timeout(180)]
ATTRIBUTES = f'() => document.querySelector("{CANVAS}").getContext("webgl2").getContextAttributes()'
SCHEME = """scheme => document.documentElement.setAttribute("data-mantine-color-scheme", scheme)"""
LEGEND = f"""() => {{
  const box = document.querySelector("{CANVAS}").parentElement;
  const look = getComputedStyle(box, "::after");
  return [box.clientWidth, box.clientHeight, parseFloat(look.width), parseFloat(look.height), look.backgroundImage];
}}"""


def volume(mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def test_shapes_are_closed_and_face_outwards():
    assert volume(rounded((1.0, 2.0, 3.0), 0.1, 8)) == pytest.approx(48, rel=0.03)
    ball = capsule(np.zeros(3), np.zeros(3), 1.0, 12)
    assert volume(ball) == pytest.approx(4 / 3 * np.pi, rel=0.02)
    long = capsule(np.array([1.0, 0, 0]), np.array([1.0, 2.0, 0]), 0.5, 12)
    assert np.allclose(long.vertices.min(axis=0), [0.5, -0.5, -0.5], atol=0.02)
    assert np.allclose(long.vertices.max(axis=0), [1.5, 2.5, 0.5], atol=0.02)
    assert len(hull(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0.5, 0]]))) == 4


def depth_below(mesh, place, normal):
    """How far below a taxel its plate lies, along the normal; infinity beside all plates."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    across = np.cross(normal, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1 / np.einsum("ij,ij->i", b - a, across)
        u = share * np.einsum("ij,ij->i", place - a, across)
        turned = np.cross(place - a, b - a)
        v, t = share * (turned @ normal), -share * np.einsum("ij,ij->i", c - a, turned)
        is_hit = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & np.isfinite(t)
    return np.abs(t[is_hit]).min(initial=np.inf)


@pytest.mark.parametrize("device", ["xela_uskin", "orca_touch", "icub_skin", "fulai_glove", "robotiq_tsf85", "anyskin"])
def test_a_plate_lies_below_each_taxel(device):
    layout = registry.create(device).layout
    for patch in layout.patches:
        places, normals = layout.positions[patch.taxels], layout.normals[patch.taxels]
        mesh = carrier(places, normals, patch.pitch)
        below = [depth_below(mesh, place, normal) for place, normal in zip(places, normals)]
        flat = 0.06 * np.ptp(places, axis=0).max()  # as far as a patch with one plate may be from flat
        assert np.abs(below).max() < 0.1 * patch.pitch + flat
        assert volume(mesh) > 0


def test_hands_are_recognised():
    def outline(device: str):
        layout = registry.create(device).layout
        return hand(
            {each.name: (layout.positions[each.taxels], layout.normals[each.taxels]) for each in layout.patches}
        )

    assert [finger_of(each) for each in ("index tip", "pinky 1a", "finger 2", "springs")] == [
        "index",
        "pinky",
        "finger 2",
        None,
    ]
    for device in (
        "inspire_rh56dftp",
        "orca_touch",
        "linker_hand_l6",
        "barrett_bh8",
        "allegro_v5_sense",
        "weiss_dsacon32m",
    ):
        mesh = outline(device)
        assert mesh is not None and np.isfinite(mesh.vertices).all(), device
        flat = registry.create(device).layout.normals[:, 2].min() > 0.99
        assert not flat or mesh.vertices[:, 2].max() < 0.004, "the hand lies below its taxels"
    for device in ("robotiq_tsf85", "xela_uskin", "icub_skin", "harp_loadcells"):
        assert outline(device) is None


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.5])
def test_the_camera_has_all_points_in_its_canvas(aspect):
    points = np.random.default_rng(1).uniform([-1, -3, 0], [1, 3, 0.5], (200, 3))
    for normals in ([[0, 0, 1.0]], [[1.0, 0, 0]], [[0, 0, -1.0]], [[1.0, 0, 0], [-1, 0, 0]]):
        towards = camera.direction(np.array(normals))
        position, target = camera.framed(points, towards, aspect)
        right = np.cross([0, 0, 1.0], towards)
        right /= np.linalg.norm(right)
        x, y, depth = np.stack([right, np.cross(towards, right), -towards]) @ (points - position).T
        tall = np.tan(camera.FIELD_OF_VIEW / 2)
        shown = np.stack([x / (depth * tall * aspect), y / (depth * tall)])
        left, side, top, bottom = (1 - 2 * each for each in camera.MARGINS)
        assert depth.min() > 0 and np.allclose(np.cross(target - position, towards), 0, atol=1e-9)
        assert (shown.min(axis=1) >= [-left - 1e-6, -bottom - 1e-6]).all() and (
            shown.max(axis=1) <= [side + 1e-6, top + 1e-6]
        ).all()
        span = np.ptp(shown, axis=1) / [left + side, top + bottom]
        assert span.max() > 0.99, "it is as near as it can be"


def canvas_drawn(page) -> np.ndarray:
    """Return the pixels of the canvas; drawing without a GPU takes about a second for each screenshot."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(page.locator(CANVAS).screenshot())).convert("RGB")).astype(int)


def taxels_drawn(image: np.ndarray) -> np.ndarray:
    """Return where the canvas has the violet of untouched taxels, as shares of its width and height."""
    red, green, blue = np.moveaxis(image, 2, 0)
    rows, cols = np.nonzero((blue - red > 22) & (blue < 140) & (abs(red - green) < 16))
    return np.stack([cols / image.shape[1], rows / image.shape[0]], axis=1)


def has_sky(image: np.ndarray, scheme: str) -> bool:
    """Return True if many pixels of the canvas have the background of its colour scheme."""
    sky, haze = (255 * rgb(THEMES[name][scheme == "dark"]) for name in ("sky", "haze"))
    return float((np.abs(image - (sky + haze) / 2).max(axis=2) < 3).mean()) > 0.1


def test_wrong_arguments_of_the_screenshots_take_none(tmp_path, monkeypatch, capsys):
    from tests.view.page import screenshots

    monkeypatch.chdir(tmp_path)
    for words, status, says in (
        (["--help"], 0, "usage: python -m tests.view.page.screenshots [-h] [FOLDER] [LABEL ...]"),
        (["folder", "hand-wied"], 2, "no label 'hand-wied'"),
    ):
        monkeypatch.setattr("sys.argv", ["screenshots", *words])
        with pytest.raises(SystemExit) as ended:
            screenshots.main()
        out, err = capsys.readouterr()
        assert ended.value.code == status and says in out + err
    assert not list(tmp_path.iterdir())


def test_the_skin_fills_the_free_canvas(runtime_folder):  # noqa: F811
    from tests.view.page.screenshots import SIZES, shown

    wrong: list[str] = []
    with shown("linker_hand_l6", "scene") as (_, url), browsing() as browser:
        for width, height in SIZES.values():
            page = opened(browser, url, wrong, width=width, height=height)
            page.add_style_tag(content=".mantine-Notification-root { display: none; }")
            page.wait_for_function(f"() => ({LEGEND})()[4] !== 'none'", timeout=60_000)
            for scheme in ("light", "dark"):
                page.evaluate(SCHEME, scheme)
                for _ in range(40):
                    page.wait_for_timeout(250)
                    image = canvas_drawn(page)
                    at, sky = taxels_drawn(image), has_sky(image, scheme)
                    if len(at) > 60 and sky:  # it is drawn anew within a second
                        break
                assert len(at) > 60, f"{width} {scheme}: no taxels are drawn"
                low, high = np.percentile(at, 2, axis=0), np.percentile(at, 98, axis=0)
                assert (low > 0.02).all() and (high < 0.98).all(), f"{width} {scheme}: taxels from {low} to {high}"
                assert (high - low).max() > 0.3, f"{width} {scheme}: the skin is small: {low} to {high}"
                wide, tall, legend_width, legend_height, picture = page.evaluate(LEGEND)
                assert legend_width + legend.INSET_PX <= wide and legend_height < 0.3 * tall
                assert picture.startswith('url("data:image/svg+xml')
                attributes = page.evaluate(ATTRIBUTES)
                assert not attributes["antialias"] and not attributes["alpha"], "it draws without a GPU"
                assert sky, f"{width} {scheme}: the background is not the theme's"
            page.context.close()
    assert not wrong
