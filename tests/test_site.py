"""The pages of the site that are no other test's: their examples run, and what is generated says what the code says."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tactemu.scene.file import parse
from tests.cli.command import ROOT

DOCS = ROOT / "docs"


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def test_the_examples_run():
    for block in blocks("coming-from.md", "python"):
        if "MyDriver" not in block:
            exec(block, {})


def test_the_scenes_are_scenes():
    (block,) = blocks("choosing.md", "toml")
    skin = parse('[[body]]\nname = "pad"\nshape = "plane"\n' + block).tables.skin[0]
    from tactemu.scene.building import make_device, sensor_model

    sensor_model(skin, make_device(skin.device, {}))


def test_what_is_written_from_the_code():
    pytest.importorskip("mkdocs", reason="pip install 'tactemu[docs]'")
    sys.path.insert(0, str(DOCS / "site"))
    import hooks

    table = hooks._conventions()
    assert re.search(r"\[`optoforce`\].*\| Fz \| z \|", table), "its z is declared"
    assert table.count("](../devices/") >= len(hooks.fp.DEVICES)
    assert "`normal_stiffness`" not in hooks._schema() and "| `rate_hz` |" in hooks._schema()
    assert all(f"| `{name}` |" in hooks._faults() for name in hooks.FAULTS)
    api = hooks._api()
    assert (
        "::: tactemu.sensors.probes.kinematic_taxel.KinematicTaxel" in api
        and "::: tactemu.session.serving.serve" in api
    )
    page = SimpleNamespace(file=SimpleNamespace(src_uri="tutorial.md"), url="tutorial.html", title="Tutorial")
    shown = hooks.on_page_markdown((DOCS / "tutorial.md").read_text(), page, None, None)
    assert '```python title="driver.py"' in shown and "```sh\n" in shown, "a fence with a bare name is none there"
    assert "<svg" not in hooks._device("sensel_morph") and len(hooks._device("sensel_morph")) < 30_000
    assert "<svg" in hooks._device("anyskin") and hooks._chart().count('"mode":"markers"') == 9


def test_what_a_page_brings_along_has_its_licence():
    for path in (DOCS / "site").rglob("*.js"):
        assert "Permission is hereby granted" in (path.parent / "LICENSE").read_text(), path
    assert Path(DOCS / "site" / "site.css").is_file()
