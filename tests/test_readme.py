"""The README's table of devices is that of the registry, and its Python runs.

``python tests/test_readme.py --write`` writes the table.
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import firmware_protocols as fp
from tactemu.cli.datasheet import ports_of

README = Path(__file__).parents[1] / "README.md"
TABLE = re.compile(r"(<!-- devices: [^\n]* -->\n).*?(<!-- end of devices -->)", re.DOTALL)


def table() -> str:
    """The devices as Markdown."""
    rows = ["| name | sensor | ports | taxels | read by |", "| --- | --- | --- | --- | --- |"]
    for name in fp.names():
        device = fp.create(name)
        ports = ", ".join(ports_of(device))
        rows.append(f"| `{name}` | {device.title} | {ports} | {len(device.layout)} | {device.judge} |")
    return "\n" + "\n".join(rows) + "\n\n"


def test_the_table_of_devices_is_that_of_the_registry():
    inside = TABLE.search(README.read_text())
    assert inside, "the README has lost the marks around its table"
    assert inside[0] == f"{inside[1]}{table()}{inside[2]}", "run: python tests/test_readme.py --write"


def test_the_simulation_in_the_readme_runs():
    block = next(b.split("```")[0] for b in README.read_text().split("```python\n")[1:] if "tt.Scene(" in b)
    names: dict = {}
    exec(block.replace('n_envs=4096, device="cuda:0"', "n_envs=2"), names)
    force = names["force"]
    assert force.shape == (2, 16, 16, 3)
    assert force[..., 2].sum() < -0.1, "pressed"


def test_every_file_that_the_readme_links_to_is_there():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text()):
        assert (README.parent / target).exists(), target


def test_every_page_is_linked():
    text = README.read_text()
    for page in (README.parent / "docs").glob("*.md"):
        assert f"(docs/{page.name})" in text, page.name


def test_every_command_that_the_documentation_shows_exists():
    from typer.main import get_command

    from tactemu.cli.app import app

    commands = get_command(app).commands
    pages = [README, *(README.parent / "docs").glob("*.md")]
    shown = {
        (page.name, name) for page in pages for name in re.findall(r"(?m)^\$? ?tactemu ([a-z]+)", page.read_text())
    }
    assert {name for _, name in shown} >= {"run", "devices", "explain", "truth", "faults", "record", "replay", "tune"}
    for page, name in shown:
        assert name in commands, f"{page}: tactemu {name}"


if __name__ == "__main__" and "--write" in sys.argv:
    README.write_text(TABLE.sub(lambda found: found[1] + table() + found[2], README.read_text()))


def test_every_folder_is_on_the_map_for_contributors():
    text = (README.parent / "CONTRIBUTING.md").read_text()
    folders = [path.parent.name for path in (README.parent / "tactemu").glob("*/__init__.py")]
    assert folders and [name for name in folders if f"`tactemu/{name}/`" not in text] == []
