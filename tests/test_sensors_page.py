"""docs/sensors.md is what the sensor models declare: formula, options, settings, and what docs/accuracy.md measured.

``python tests/test_sensors_page.py --write`` writes it.
"""

import ast
import dataclasses
import inspect
import re
import sys
import textwrap
import types
import typing
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_protocols.bounds import Bounds
from scripts.contents import with_contents
from tactemu.imperfections import ElectronicsOptions, ImperfectionOptions
from tactemu.imperfections.laws import BOUNDS
from tactemu.imperfections.options import ChainOptions
from tactemu.sensors.drawing import DrawOptions
from tactemu.sensors.models import MODELS, cheapest, model_class
from tactemu.sensors.sensor_model import SensorModel
from tactemu.tune.trade.settings import ladder

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "sensors.md"
HEAD = """# Sensor models

<!-- written from the models' declarations: python tests/test_sensors_page.py --write -->

A sensor model turns contact into the readings of taxels. A scene file names one (`model = "kinematic_taxel"`, or
`path/to/file.py:Class`), Python makes one (`tt.KinematicTaxel(...)`); without a name a skin takes the cheapest
model that gives the quantity of its device. Positions, normals and readings are in the frame of the link, normals
point out of the skin, units are SI. Forces and torques of every model act on the skin: a press is a force along minus
the normal, a body that slides drags the skin along (`convention="genesis"` gives Genesis's signs). Costs and errors
below are those of [speed for accuracy](accuracy.md): one step of 1024 taxels on one core, and median errors over
contacts that were not used for fitting. [Contact](contact.md) explains the depth of a body in a probe,
[differences](differences.md) where the models differ from those of Genesis whose options they share, and [adding a
sensor model](adding-a-sensor-model.md) how to write your own.
"""
GEOMETRY = """## Options of every model

Every model has these options, its own, and the three groups at the end of this page. A scene file has all of them side
by side under `[skin.options]`. Numbers without a range are at most 1e12 in magnitude.
"""
IMPERFECTIONS = """## Imperfections of the skin

The fields of `imperfections=tt.ImperfectionOptions(...)`. They are off by default; [imperfections](imperfections.md)
describes them.
"""
ELECTRONICS = """## Imperfections of the electronics

The fields of `electronics=tt.ElectronicsOptions(...)`. They are off by default; [imperfections](imperfections.md)
describes them.
"""
DRAWING = """## Drawing

The fields of `draw=tt.DrawOptions(...)`. They set how viewers draw a sensor, and change no reading.
"""


def docstrings(cls) -> dict[str, str]:
    """The docstring under each attribute of a class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        node.target.id: inspect.cleandoc(after.value.value)
        for node, after in zip(tree.body, tree.body[1:])
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    }


def words(text: str) -> str:
    """A docstring's words as Markdown, on one line."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", " ".join(text.split()))
    return text.replace("``", "`")


def row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def unit_of(text: str) -> str:
    """The unit in a docstring: the first brackets that hold no range and no shape."""
    return next((found for found in re.findall(r"\[([^\]]+)\]", text) if not re.match(r"[-\d.]+,|n_envs", found)), "")


def bounds_of(hint) -> Bounds | None:
    """The range of a number, or of one that may be left out, in its declared type."""
    alternatives = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    bounds = [extra for each in alternatives for extra in getattr(each, "__metadata__", ())]
    return next((each for each in bounds if isinstance(each, Bounds)), None)


def options_table(cls) -> str:
    """The options that a class itself declares: default, unit, range and meaning."""
    said, hints = docstrings(cls), typing.get_type_hints(cls, include_extras=True)
    rows = ["| option | default | unit | range | meaning |", "| --- | --- | --- | --- | --- |"]
    for field in dataclasses.fields(cls):
        if field.init and field.name in cls.__annotations__:
            text = said[field.name]
            bounds = BOUNDS.get(field.name) if issubclass(ChainOptions, cls) else bounds_of(hints[field.name])
            limits = " and ".join(bounds.limits()) if bounds else ""
            rows.append(row(f"`{field.name}`", f"`{field.default!r}`", words(unit_of(text)), limits, words(text)))
    return "\n".join(rows) if rows[2:] else "It has no options of its own."


def formula(cls) -> str:
    """The docstring of a model's module as Markdown: literal blocks fenced."""
    text = inspect.getdoc(inspect.getmodule(cls)) or ""
    parts = []
    for paragraph in text.split("\n\n"):
        if paragraph.startswith(" "):
            parts.append(f"```text\n{textwrap.dedent(paragraph)}\n```")
        else:
            parts.append(words(re.sub(r"::$", ":", paragraph)))
    return "\n\n".join(parts)


def measured() -> dict[str, list[str]]:
    """By the name of a setting: its cells in docs/accuracy.md; by ``setting``, the table's head."""
    table = (DOCS / "accuracy.md").read_text(encoding="utf-8").split("## All figures")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:2] == "| "]
    return {row[0]: row[1:] for row in rows}


def cost_and_error(name: str) -> str:
    """What docs/accuracy.md says of a model: the columns that have a figure."""
    found = measured()
    rows = {
        setting.name: found[setting.name] for setting in ladder() if setting.model == name and setting.name in found
    }
    columns = [k for k, _title in enumerate(found["setting"]) if any(cells[k] for cells in rows.values())]
    lines = [row("setting", *(found["setting"][k] for k in columns)), "| --- |" + " --- |" * len(columns)]
    lines += [row(setting, *(cells[k] for k in columns)) for setting, cells in rows.items()]
    return "\n".join(lines) if rows else "Not measured yet: `tactemu bench trade`."


def settings(cls) -> str:
    """What ``tactemu tune`` tries, quantity by quantity where that matters."""
    names = list(dict.fromkeys(trial.name for quantity in cls.layouts for trial in cls.trials(quantity)))
    return "; ".join(names)


def section(name: str) -> str:
    cls = model_class(name)
    gives = ", ".join(f"{quantity}{' (by default)' if cheapest(quantity) == name else ''}" for quantity in cls.layouts)
    scaled = ", ".join(f"`{option}`" for option in cls.strengths)
    strengths = f"\n\nOptions that scale every channel of the reading, for a calibration: {scaled}." if scaled else ""
    return f"""## {cls.__name__}

`model = "{name}"`, level {cls.level}. Quantities for a device: {gives}. {words(cls.__doc__ or "")}

{formula(cls)}

**Valid.** {cls.valid}

**Source.** {cls.source}

{options_table(cls)}{strengths}

`tactemu tune` tries: {settings(cls)}.

{cost_and_error(name)}
"""


def page() -> str:
    overview = ["| model | level | gives | unit |", "| --- | --- | --- | --- |"]
    for name in MODELS:
        cls = model_class(name)
        link = f"[`{cls.__name__}`](#{cls.__name__.lower()})"
        overview.append(row(link, str(cls.level), ", ".join(cls.layouts), cls.unit))
    shared = f"{GEOMETRY}\n{options_table(SensorModel)}\n"
    groups = [
        f"{title}\n{options_table(group)}\n"
        for title, group in (
            (IMPERFECTIONS, ImperfectionOptions), (ELECTRONICS, ElectronicsOptions), (DRAWING, DrawOptions),
        )
    ]  # fmt: skip
    parts = [HEAD, "\n".join(overview) + "\n", shared, *(section(name) for name in MODELS), *groups]
    return with_contents("\n".join(parts))


def test_the_page_is_what_the_models_say():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python tests/test_sensors_page.py --write"


def test_a_changed_default_is_seen(monkeypatch):
    field = next(f for f in dataclasses.fields(model_class("elastomer_taxel")) if f.name == "lambda_d")
    monkeypatch.setattr(field, "default", 701.0)
    assert page() != PAGE.read_text(encoding="utf-8")


def test_ranges_are_those_that_are_checked():
    for line in ("| `poisson_ratio` | `0.49` |  | >= 0 and <= 0.5 |", "| `delay` | `0.0` | s | >= 0 and <= 1e+06 |",
                 "| `kinetic_friction` | `None` |  | >= 0 |", "| `bias` | `0.0` | unit |  |"):  # fmt: skip
        assert f"\n{line} " in page(), line


def test_every_model_that_accuracy_measured_has_its_figures():
    text = page()
    for setting in measured():
        assert f"| {setting} |" in text


if __name__ == "__main__":
    if "--write" in sys.argv:
        PAGE.write_text(page(), encoding="utf-8")
