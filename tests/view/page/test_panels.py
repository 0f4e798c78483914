"""What the panels say: names, units, rows of pictures, frames and answers in words; without a browser."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from firmware_protocols import registry
from firmware_protocols.declared import tables_of
from firmware_protocols.tables import Frame
from tactemu.control.description import _device
from tactemu.scene.description import SceneContext
from tactemu.session.heatmap import cells
from tactemu.truth import COMMAND
from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import prefixed, written
from tactemu.view.page.feed import Baseline, DescribedRun, PageSkin, deviation_unit

pytest.importorskip("viser", reason="the page comes with the extra web")

from tactemu.view.page import pictures, readings
from tactemu.view.page.ranges import NO_CONTACT, Ranges
from tactemu.view.page.viewer_commands import answer_words
from tactemu.view.page.wire import Wire

PAGE = Path(__file__).parents[3] / "tactemu/view/page"


def described(name: str) -> DescribedRun:
    device = registry.create(name)
    scene = SceneContext(None, {name: device}, {}).description()
    return DescribedRun({"scene": scene, "devices": {name: _device(device)}})


def skin(name: str) -> PageSkin:
    return described(name).skins[name]


def sample(name: str, ideal, counts) -> Sample:
    return Sample(0, name, np.asarray(ideal, float), np.asarray(ideal, float), np.asarray(counts))


def test_numbers_have_a_prefix_in_which_they_are_short():
    assert prefixed(0.3, "N") == (1e3, "mN") and prefixed(0.0021, "m") == (1e3, "mm")
    assert prefixed(21_000, "Pa") == (1e-3, "kPa") and prefixed(4e-5, "T") == (1e6, "µT")
    assert prefixed(2.0, "N") == (1.0, "N") and prefixed(0.0, "N") == (1.0, "N") == prefixed(np.nan, "N")
    assert prefixed(0.02, "degC") == (1.0, "°C"), "no prefix"
    assert written("uT") == "µT"


def test_channels_have_names_and_the_unit_of_a_count():
    assert [(each.name, each.unit) for each in skin("anyskin").channels("", 4)] == [
        ("T", "°C"), ("Bx", "µT"), ("By", "µT"), ("Bz", "µT")
    ]  # fmt: skip
    assert [each.unit for each in skin("aidin_aft200").channels("", 6)] == ["10 mN"] * 3 + ["2 mNm"] * 3
    assert skin("flexitac").channels("", 1)[0].unit == "counts", "no published scale"
    assert [each.name for each in skin("digity_exohand").channels("acceleration", 4)] == ["touch", "x", "y", "z"]
    assert [each.name for each in skin("anyskin").channels("", 2)] == ["channel 0", "channel 1"], "not as many"


@pytest.mark.parametrize("name", registry.names())
def test_every_device_has_a_picture_or_a_reason(name):
    run = described(name)
    page_skin = run.skins[name]
    n = len(page_skin.layout)
    shape = (n, 3) if page_skin.quantity("") == "force" else (n, 6) if page_skin.quantity("") == "wrench" else (n,)
    columns = len(page_skin.about["columns"])
    entry = sample(name, np.linspace(0, 1, int(np.prod(shape))).reshape(shape), np.zeros((n, columns)))
    html = pictures.Pictures(Ranges(run)).html(page_skin, entry, np.zeros(n))
    assert html.count("<img") >= min(n, 3) and ("<img" in html or "No picture" in html)
    assert "tt-numbers" in readings.readings_html(page_skin, entry, 0) or not n


def test_legend_and_pictures_have_one_range():
    run = described("inspire_rh56dftp")
    name, page_skin = next(iter(run.skins.items()))
    ranges, taxels = Ranges(run), len(page_skin.layout)
    (scale,) = ranges
    drawn = pictures.Pictures(ranges)
    for ideal, measured, end in ((0.0, 0.0, ""), (0.3, 0.12, "400 mN"), (0.2, 1.7, "2 N"), (0.1, np.nan, "2 N")):
        entry = Sample(0, name, np.full(taxels, ideal), np.full(taxels, measured), np.zeros(taxels))
        ranges.include({name: entry})
        html = drawn.html(page_skin, entry, None)
        assert scale.end() == end and html.count(f"<span>{end or NO_CONTACT}</span>") >= 2
        assert ranges.of(name, entry.sense) is scale and not scale.shares(np.array([scale.top])) > 1


def test_a_changed_temperature_is_no_touch():
    rest, page_skin = np.tile([25.0, -38.0, 21.0, 412.0], (5, 1)), skin("anyskin")
    baseline = Baseline(page_skin)

    def deviation(ideal: float, change: list[float]) -> list[float]:
        found = baseline.deviation(sample("anyskin", np.full((5, 3), ideal), rest + np.array(change)))
        assert found is not None
        return found.tolist()

    assert deviation(0, [0, 0, 0, 0]) == [0] * 5
    assert deviation(0, [4, 0, 0, 0]) == [0] * 5, "warmer"
    assert deviation(1, [0, 3, 4, 0]) == [5] * 5, "pushed"
    assert deviation_unit(page_skin.channels("", 4)) == "µT"


def test_a_hand_is_drawn_finger_by_finger():
    layout = registry.create("inspire_rh56dftp").layout
    rows = pictures.picture_rows([(patch, cells(layout, patch)) for patch in layout.patches])
    names = [[[patch.name for patch, _ in column] for column in row] for row in rows]
    assert [column[0] for column in names[0]] == ["thumb tip", "index tip", "middle tip", "ring tip", "little tip"]
    assert names[0][0] == ["thumb tip", "thumb top", "thumb middle", "thumb pad"] and names[1] == [["palm"]]
    glove = registry.create("fulai_glove").layout
    rows = pictures.picture_rows([(patch, cells(glove, patch)) for patch in glove.patches])
    assert len(pictures._lines_px(rows[0], pictures.taxel_size(rows))) == 1, "five fingers stand side by side"
    sheet = registry.create("flexitac").layout
    assert len(pictures.picture_rows([(patch, cells(sheet, patch)) for patch in sheet.patches])) == 1


def row(kind: str, data: str = "", **more) -> dict:
    return {"t_ns": 1_500_000_000, "device": "linker_hand_l6", "kind": kind, "data": data, **more}


def test_frames_are_told_in_words():
    wire = Wire(described("linker_hand_l6"))
    wire.add([row("rx", "028#C2"), row("tx", "028#C2010203")], 0)
    html = wire.html()
    assert "← question" in html and "→ answer" in html and html.count("firmware version") == 2
    assert "1.500 s" in html and html.index("→ answer") < html.index("← question"), "newest first"
    fault = {"what": "flip", "detail": "flip 20% at 15ns for 5s", "before": "028#C2010203", "after": ["028#C2010207"]}
    wire.add([row("inject", **fault)], 0)
    assert "✕ fault" in wire.html() and "flip 20% for 5s" in wire.html() and "byte 3: 03 → 07" in wire.html()


def test_an_event_names_who_caused_it():
    wire = Wire(described("linker_hand_l6"))
    press = {"verb": "press", "args": {"depth": 1e-3, "dwell": 1.0, "taxel": 3, "skin": "x", "wait": False}}
    for by in ("viewer 1", ""):
        wire.add([row("event", what=COMMAND + json.dumps(press | {"by": by}))], 0)
    assert wire.html().count("</b>, by ") == 1 and "</b>, by viewer 1" in wire.html()


def test_fields_of_a_table_have_their_names_and_remarks():
    device = registry.create("robotiq_ft300")
    (table,) = (each for each in tables_of(type(device), Frame) if each.name == "stream")
    wire = Wire(described("robotiq_ft300"))
    wire.add([row("tx", table.pack(values=[100, -200, 0, 0, 0, 7]).hex()) | {"device": "robotiq_ft300"}], 0)
    html = wire.html()
    assert "→ data" in html and "<b>stream</b>: values 100 -200 0 0 0 7" in html
    assert "(Fx Fy Fz [0.01 N], Mx My Mz [0.001 Nm])" in html


def test_frames_that_no_driver_could_read_are_one_line():
    wire = Wire(described("linker_hand_l6"))
    wire.add([row("drop", "028#C2010203", why="no reader", sample=k) for k in range(9)], 0)
    assert wire.is_unheard("linker_hand_l6") and wire.html().count("tt-frame") == 1 and "9 frames" in wire.html()
    wire.add([row("rx", "028#C2")], 0)
    assert not wire.is_unheard("linker_hand_l6")


def test_what_a_command_has_done_is_said():
    press = {"depth": 1e-3, "dwell": 1.0, "taxel": 3, "skin": "x", "wait": False}
    assert answer_words("press", press) == "pressed taxel 3 by 1.0 mm for 1 s"
    assert answer_words("unplug", {"seconds": 1.0}) == "unplugged for 1 s"
    assert answer_words("mend", {}) == "all faults ended"
    assert answer_words("set", {"options": {"noise": 0.1}}) == "noise set to 0.1"
    assert answer_words("dead", {"taxels": [2]}) == "dead taxels, which return a constant value: 2"
    assert answer_words("step", {"n": 3}) == "step n=3"


def test_every_control_says_what_it_does():
    kinds = {"add_slider", "add_number", "add_dropdown", "add_text", "add_button_group", "add_button", "add_checkbox"}
    calls = [
        (file.name, node)
        for file in PAGE.glob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in kinds
    ]
    assert len(calls) > 10
    assert not [f"{name}:{call.lineno}" for name, call in calls if "hint" not in {each.arg for each in call.keywords}]
