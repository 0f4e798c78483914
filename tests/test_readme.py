"""What is written from the code is true: the README's devices, and the files behind `tactemu devices` and `--help`.

``python tests/test_readme.py --write`` writes all three.
"""

import contextlib
import io
import json
import os
import re
import sys
import tomllib
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[1]))

import firmware_protocols as fp
from tactemu.cli import HELP, HELP_COLUMNS, listing

README = Path(__file__).parents[1] / "README.md"
TABLE = re.compile(r"(<!-- devices: [^\n]* -->\n).*?(<!-- end of devices -->)", re.DOTALL)


def rows() -> list[dict]:
    """Of every device of this package, made."""
    return [listing.row_or_error(name) for name in sorted(fp.DEVICES)]


def written() -> str:
    """Rows as JSON, a line each."""
    return "[\n" + ",\n".join(map(json.dumps, rows())) + "\n]\n"


def help_text() -> str:
    """As the parser makes it."""
    from tactemu.cli.app import app

    text = io.StringIO()
    with contextlib.redirect_stdout(text), mock.patch.dict(os.environ, {"COLUMNS": str(HELP_COLUMNS)}):
        with contextlib.suppress(SystemExit):
            app(["--help"], prog_name="tactemu")
    return text.getvalue()


def table() -> str:
    """A line for each kind of device: how many, and their makers, by the first word of their titles."""
    lines = ["| kind | devices | by |", "| --- | ---: | --- |"]
    for heading, found in listing.by_kind(rows()):
        anchor = re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
        makers = sorted({row["title"].split()[0].strip(",") for row in found}, key=str.lower)
        lines.append(f"| [{heading}](docs/devices.md#{anchor}) | {len(found)} | {', '.join(makers)} |")
    return "\n" + "\n".join(lines) + "\n\n"


def test_the_table_of_devices_is_that_of_the_registry():
    inside = TABLE.search(README.read_text())
    assert inside, "the README has lost the marks around its table"
    assert inside[0] == f"{inside[1]}{table()}{inside[2]}", "run: python tests/test_readme.py --write"


def test_the_file_that_devices_are_listed_from_is_that_of_the_registry():
    assert listing.FILE.read_text() == written(), "run: python tests/test_readme.py --write"
    assert [row["name"] for row in rows() if not row["kind"]] == [], "these do not say their kind"


def test_the_help_is_that_of_the_parser():
    assert Path(HELP).read_text() == help_text(), "run: python tests/test_readme.py --write"


def test_the_readme_is_a_screen_or_two():
    assert len(README.read_text().splitlines()) <= 120


def test_every_file_that_is_linked_to_is_there():
    for page in (README, *README.parent.glob("docs/*.md"), *README.parent.glob("*.md")):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_long_pages_have_contents():
    from scripts.contents import with_contents

    for page in (README.parent / "docs").glob("*.md"):
        assert page.read_text() == with_contents(page.read_text()), f"{page.name}; run: scripts/contents.py"


def test_the_pages_with_their_pictures_are_small():
    files = [path for path in (README.parent / "docs").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= 8_000_000


def test_every_page_is_linked():
    text = README.read_text()
    places = (README.parent / "mkdocs.yml").read_text()
    for page in (README.parent / "docs").glob("*.md"):
        assert f"(docs/{page.name})" in text, page.name
        assert len(re.findall(rf"[ /]{page.name}$", places, re.MULTILINE)) == 1, f"{page.name}: its place on the site"


def test_the_package_describes_itself_as_its_help_does():
    project = tomllib.loads((README.parent / "pyproject.toml").read_text())["project"]
    assert project["description"] in " ".join(Path(HELP).read_text().split())


def test_pages_name_who_does_what():
    """Pages say "no node", "a client", "the driver"."""
    for page in (README, *(README.parent / "docs").glob("*.md")):
        assert re.findall(r"(?i)\b(?:nobody|somebody|whoever|of theirs|for who)\b", page.read_text()) == [], page.name


if __name__ == "__main__" and "--write" in sys.argv:
    Path(HELP).write_text(help_text())
    listing.FILE.write_text(written())
    README.write_text(TABLE.sub(lambda found: found[1] + table() + found[2], README.read_text()))


def test_every_folder_is_on_the_map_for_contributors():
    text = (README.parent / "CONTRIBUTING.md").read_text()
    folders = [path.parent.name for path in (README.parent / "tactemu").glob("*/__init__.py")]
    assert folders and [name for name in folders if f"`tactemu/{name}/`" not in text] == []


def test_plans_layouts_and_statistics_are_shown_in_notebooks():
    import xml.etree.ElementTree as xml

    from tactemu.base.statistics import ChannelStatistics
    from tactemu.plan.plan import Plan, Stage

    for name in ("anyskin", "inspire_rh56dftp", "feetech_sts3215"):
        layout = fp.device_class(name)().layout
        picture = xml.fromstring(layout._repr_html_())
        assert len(picture.findall("{http://www.w3.org/2000/svg}circle")) == len(layout)
    plan = Plan([Stage(name="depth", reason="<b> asks for it", launch=lambda: None, cost_us=1.25)])
    assert "<td>depth</td><td>1.2</td><td>&lt;b&gt; asks for it</td>" in plan._repr_html_()
    assert "<td>samples</td><td>0</td>" in ChannelStatistics()._repr_html_()
