"""Pages of the site that are written from the code, and what it brings along: MkDocs calls these functions."""

from __future__ import annotations

import base64
import html
import importlib.metadata
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
MAX_TAXELS_DRAWN = 5000
"""Taxels of a device above which its page has the small picture: a browser draws 20,000 elements for half a minute."""
sys.path.insert(0, str(ROOT))

from mkdocs.structure.files import File, Files  # noqa: E402

import firmware_protocols as fp  # noqa: E402
import tactemu  # noqa: E402
from tactemu import envs, models  # noqa: E402
from tactemu.base import style  # noqa: E402
from tactemu.cli.datasheet import datasheet  # noqa: E402
from tactemu.scene.file import json_schema  # noqa: E402
from tactemu.session.options import ServeOptions  # noqa: E402
from tactemu.wire.faults import DIRECTIONS, FAULTS  # noqa: E402
from tactemu.wire.line_models import kinds_with, modelled_for  # noqa: E402

_INHERITED = ("Sensor", "Served", "Simulation")
"""Classes whose methods are spread over base classes that have no entry of their own."""
_DEVICE_LINK = re.compile(r"\[`(\w+)`\]\(\.\./firmware_protocols/devices/\w+\.py\)")
"""The file of a device in the repository; the site has a page of it."""
_SCHEME = """
const frame = document.querySelector(".front iframe"), body = document.body;
const play = () => frame.src = frame.dataset.src + (body.dataset.mdColorScheme === "slate" ? "&darkMode" : "");
new MutationObserver(play).observe(body, { attributeFilter: ["data-md-color-scheme"] });
play();
"""
"""The recording is as light or dark as the page."""
_ABOUT: dict[str, tuple[str, str]] = {}
"""Title and first sentence of each page, by its URL."""


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that no file has, the plot library and viser's player with their licences, and the style."""
    pages = {
        "index.md": _index(),
        "reference/api.md": _api(),
        "reference/scene-schema.md": _schema(),
        "reference/faults.md": _faults(),
        "reference/conventions.md": _conventions(),
        **{f"devices/{name}.md": _device(name) for name in fp.DEVICES},
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    library, licence = _of_package("plotly", "plotly/package_data/plotly.min.js")
    files.append(File.generated(config, "assets/plotly.min.js", content=library))
    files.append(File.generated(config, "assets/plotly.LICENSE.txt", content=licence))
    player, licence = _of_package("viser", "viser/client/build/index.html")
    files.append(File.generated(config, "assets/live.html", content=_recorded(player)))
    files.append(File.generated(config, "assets/viser.LICENSE.txt", content=licence))
    for name in ("live.viser", "live.json", "card.html"):  # parts of other files
        files.remove(files.get_file_from_path(f"pictures/{name}"))
    for name in ("shim.js", "LICENSE"):  # iframe-worker 1.0.4
        text = (Path(__file__).parent / "iframe-worker" / name).read_text()
        files.append(File.generated(config, f"assets/iframe-worker/{name}", content=text))
    light, dark = (f'[data-md-color-scheme="{scheme}"]' for scheme in ("default", "slate"))
    sheet = style.stylesheet(light, dark) + (Path(__file__).parent / "site.css").read_text()
    files.append(File.generated(config, "assets/site.css", content=sheet))
    return files


def on_post_page(output: str, page: Any, config: Any) -> str:
    """What Material fetches for the search of files that no server serves is brought along."""
    shim = page.url.count("/") * "../" + "assets/iframe-worker/shim.js"
    return output.replace("https://unpkg.com/iframe-worker/shim", shim)


def on_page_content(content: str, page: Any, config: Any, files: Files) -> str:
    """Figures that follow the page's colours: what the front page shows, and the picture of the trade-off."""
    if page.file.src_uri == "accuracy.md":
        picture = f'<div class="wide">{style.figure(_svg("accuracy"))}</div>'
        return re.sub(r'<p><img [^>]*src="pictures/accuracy\.svg"[^>]*></p>', lambda _: picture, content)
    if page.file.src_uri == "index.md":
        return re.sub(r'<p><img [^>]*src="pictures/live\.gif"[^>]*></p>', lambda _: _front(), content)
    return content


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links out of the pages become names, the place of the chart the chart; contents are beside the page already."""
    markdown = re.sub(r"<!-- contents -->\n.*?\n\n", "", markdown, flags=re.DOTALL)
    markdown = re.sub(r"^```(\w+) (\S+)$", r'```\1 title="\2"', markdown, flags=re.MULTILINE)
    if page.file.src_uri == "devices.md":
        markdown = _DEVICE_LINK.sub(r"[`\1`](devices/\1.md)", markdown)
    if "/" not in page.file.src_uri:  # those above are in the repository, not on the site
        markdown = re.sub(r"\[([^\]]+)\]\(\.\./([^)]+)\)", r"`\2`", markdown)
    if "<!-- chart: trade -->" in markdown:
        markdown = markdown.replace("<!-- chart: trade -->", _chart())
    words = re.sub(r"```.*?```|<[^>]+>|[#`*|\[\]]|!\[.*?\)", " ", markdown, flags=re.DOTALL).split()
    _ABOUT[page.url] = (page.title or page.url, " ".join(words[:30]))
    return markdown


def on_post_build(config: Any) -> None:
    """``llms.txt``: what there is, for programs that read."""
    lines = ["# tactemu", "", f"> {config['site_description']}", "", "## Pages", ""]
    lines += [f"- [{title}]({url}): {about}" for url, (title, about) in _ABOUT.items()]
    (Path(config["site_dir"]) / "llms.txt").write_text("\n".join(lines) + "\n")


def _of_package(name: str, path: str) -> tuple[bytes, str]:
    """Return a file that an installed package contains, and the package's licence."""
    package = importlib.metadata.distribution(name)
    licence = next(file for file in package.files or () if file.name.startswith("LICENSE"))
    return Path(str(package.locate_file(path))).read_bytes(), licence.read_text()


def _recorded(player: bytes) -> str:
    """Return viser's player with the recording in it, so that it also plays from a file that no server serves."""
    recording = base64.b64encode((PICTURES / "live.viser").read_bytes()).decode()
    legend = json.loads((PICTURES / "live.json").read_text())["legend"]
    quiet = "<style>.mantine-Notifications-root { display: none; }</style>"
    head, found, rest = player.decode().partition("</head>")
    return f'{head}{legend}{quiet}<script>window.__VISER_EMBED_DATA__ = "{recording}";</script>{found}{rest}'


def _svg(name: str) -> str:
    text = (PICTURES / f"{name}.svg").read_text()
    return re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)


def _front() -> str:
    """Return what the front page shows side by side: the live page, recorded; a report card; the trade-off."""
    about = json.loads((PICTURES / "live.json").read_text())
    places = {
        f"initialCamera{name}": about[key]
        for name, key in (("Position", "position"), ("LookAt", "look_at"), ("Fov", "fov"))
    }
    query = "&amp;".join(f"{name}={','.join(map(str, place))}" for name, place in places.items())
    card = re.sub(r".*<body[^>]*>|</body>.*| id=\"[^\"]*\"", "", (PICTURES / "card.html").read_text(), flags=re.DOTALL)
    command = html.unescape(re.findall(r"<footer>Made by <code>(.*?)</code>", card)[0])
    figures = (
        (
            "Press it on the live page",
            "live-page.md",
            "A touched glove, recorded: turn it, stop it.",
            "tactemu see --demo",
            f'<iframe title="a recorded run" data-src="assets/live.html?hideViserLogo&amp;{query}"></iframe>',
        ),
        (
            "Judge your driver",
            "judge.md",
            "The report card of a driver that checks nothing.",
            command,
            f'<div class="report" tabindex="0">{card}</div>',
        ),
        (
            "Choose speed or accuracy",
            "accuracy.md",
            "Error of the normal force against the cost of a step.",
            "tactemu bench trade",
            style.themed(_svg("trade")),
        ),
    )
    shown = "".join(
        f'<figure><h2><a href="{page.replace(".md", ".html")}">{title}</a></h2>{what}'
        f"<figcaption>{about} <code>{html.escape(command)}</code></figcaption></figure>"
        for title, page, about, command, what in figures
    )
    return f'<div class="front">{shown}</div><script>{_SCHEME}</script>'


def _index() -> str:
    """The README up to its devices, with links as the site has them."""
    text = "---\nhide: [navigation, toc]\n---\n" + (ROOT / "README.md").read_text().split("## Devices")[0]
    text = (
        text.replace("](docs/", "](")
        .replace("](examples)", "](coming-from.md)")
        .replace("[CONTRIBUTING](CONTRIBUTING.md)", "CONTRIBUTING")
    )
    return text + "\nMore: [all devices](devices.md), [the tutorial](tutorial.md).\n"


def _api() -> str:
    """The public names of the faces, each once, and of the public modules of the kit."""
    lines = ["# API", "", "Public are the names below, with their documented arguments.", ""]
    lines += ["`tactemu.devices` has the names of `firmware_protocols`.", ""]
    shown: set[str] = set()
    for face in (tactemu, envs, fp, *filter(inspect.ismodule, (getattr(fp, name) for name in fp.__all__)), models):
        lines += [f"## `{face.__name__}`", ""]
        for name in face.__all__:
            found = getattr(face, name)
            module, qualified = getattr(found, "__module__", None), getattr(found, "__qualname__", None)
            address = f"{module}.{qualified}"
            if address in shown:
                continue
            if module and qualified and module.split(".")[0] in ("tactemu", "firmware_protocols"):
                shown.add(address)
                lines += [f"::: {address}", "    options:", "      heading_level: 3"]
                lines += ["      inherited_members: true", ""] if name in _INHERITED else [""]
                if found is tactemu.serve:
                    members = ", ".join(ServeOptions.__annotations__)
                    lines += ["::: tactemu.session.options.RunOptions", "    options:", "      heading_level: 4"]
                    lines += ["      inherited_members: true", f"      members: [{members}]", ""]
    return "\n".join(lines)


def _cell(text: Any) -> str:
    return str(text).replace("|", "\\|").replace("\n", " ")


def _schema() -> str:
    """The tables of a scene file, from its JSON schema."""
    schema = json_schema()
    lines = ["# Scene schema", "", "`tactemu explain --schema` prints it as JSON, for editors.", ""]
    for name, table in {"SceneFile": schema, **schema["$defs"]}.items():
        if "properties" not in table:
            continue
        about = (table.get("description") or "").split("\n\n")[0]
        lines += [f"## {name}", "", about, "", "| key | type | default | meaning |", "| --- | --- | --- | --- |"]
        for key, given in table["properties"].items():
            default = "required" if key in table.get("required", ()) else f"`{given.get('default', '')}`"
            row = (f"`{key}`", _kind(given), default, given.get("description", ""))
            lines.append(f"| {' | '.join(map(_cell, row))} |")
        lines.append("")
    return "\n".join(lines)


def _kind(given: dict[str, Any]) -> str:
    if "$ref" in given:
        return given["$ref"].rsplit("/", 1)[1]
    if "const" in given:
        return f"`{given['const']!r}`"
    choices = given.get("anyOf") or given.get("oneOf")
    return " or ".join(dict.fromkeys(map(_kind, choices))) if choices else given.get("type", "any")


def _faults() -> str:
    lines = ["# Faults", "", "What `--fault` and a skin's `faults` take; [the wire](../wire.md) explains them.", ""]
    lines += ["| fault | what it does | options | where |", "| --- | --- | --- | --- |"]
    for word, fault in FAULTS.items():
        where = "every line" if fault.every_line else ", ".join(kinds_with(word))
        where += "".join(f"; no real {kind} line" for kind in modelled_for(word))
        row = (f"`{word}`", fault.about, ", ".join(fault.own_options()), where)
        lines.append(f"| {' | '.join(map(_cell, row))} |")
    form = f"KIND [N% | every N] [id=0x201] [prefix=55aa] [{' | '.join(DIRECTIONS)}] [at T [for T] | from T] [to T]"
    return "\n".join([*lines, "", f"```text\n{form}\n```", ""])


def _conventions() -> str:
    """What each device declares of its signs, side by side."""
    lines = [
        "# Signs and frames",
        "",
        "In tactemu a taxel's z axis is its normal and points out of the skin; forces are those acting on the skin, so",
        "that a push has a negative component along z. A vendor's wire has signs of its own: what each device declares",
        "of its numbers, by [its datasheet](../devices.md).",
        "",
        "| device | number | axis | unit | counts per unit | at rest | when its taxel is pushed | so +z on this wire |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    way = {1: "rises", -1: "falls", 0: "need not move"}
    meaning = {1: "into the skin", -1: "out of the skin", 0: "not declared"}
    for name in sorted(fp.DEVICES):
        columns = fp.device_class(name)().columns
        for column in columns:
            scale = "not declared" if column.counts_per_unit is None else f"{column.counts_per_unit:g}"
            plus_z = meaning[column.push] if column.axis == "z" else ""
            row = (
                f"[`{name}`](../devices/{name}.md)", column.name, column.axis or "none", column.unit or "not declared",
                scale, f"{column.rest:g}", way[column.push], plus_z,
            )  # fmt: skip
            lines.append(f"| {' | '.join(map(_cell, row))} |")
        if not columns:
            lines.append(f"| [`{name}`](../devices/{name}.md) | not declared | | | | | | not declared |")
    return "\n".join(lines) + "\n"


def _device(name: str) -> str:
    """The datasheet, and a picture of where the taxels are."""
    device = fp.device_class(name)()
    sheet = "\n".join(line.rstrip() for line in datasheet(name, device))
    command = f'python -c "import firmware_protocols as fp; print(fp.create({name!r}).layout.picture(400))"'
    drawn = device.layout.picture(400)
    if len(device.layout) > MAX_TAXELS_DRAWN:
        drawn = f"![{name}, thinned out](../pictures/devices/{name}.svg)"
        command = "scripts/device_pages.py"
    picture = f"## Where its taxels are\n\n{drawn}\n\n*`{command}`*\n\n"
    picture = picture if len(device.layout) else ""
    return f"# {device.title}\n\n`tactemu run {name}`\n\n{picture}## Datasheet\n\n````text\n{sheet}\n````\n"


def _chart() -> str:
    """Cost against error of every setting, from the table in accuracy.md."""
    import plotly.graph_objects as go

    text = (ROOT / "docs" / "accuracy.md").read_text().split("## All figures")[1].split("\n## ")[0]
    head, _, *rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    figure = go.Figure()
    for column in range(4, len(head)):
        points = [(float(row[1]), float(row[column].split(" %")[0]), row) for row in rows if "%" in row[column]]
        figure.add_scatter(
            x=[x for x, _, _ in points], y=[y for _, y, _ in points], mode="markers", name=head[column],
            text=[f"{row[0]}<br>{head[column]}: {row[column]}" for _, _, row in points],
            hovertemplate="%{text}<br>%{x:g} µs<extra></extra>", visible=True if column == 4 else "legendonly",
        )  # fmt: skip
    axis = {"type": "log", "zeroline": False, "dtick": 1}
    figure.update_layout(
        xaxis={**axis, "title": "one step of 1024 taxels [µs]"}, yaxis={**axis, "title": "median error [%]"},
        paper_bgcolor="rgba(0,0,0,0)", plot_bgcolor="rgba(0,0,0,0)", colorway=[*style.SERIES, style.LIGHT["muted"]],
        margin={"l": 60, "r": 10, "t": 60, "b": 60}, legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        height=460,
    )  # fmt: skip
    options = {"responsive": True, "displaylogo": False, "displayModeBar": False}
    body = figure.to_html(full_html=False, include_plotlyjs="assets/plotly.min.js", config=options, div_id="trade")
    return f'<div class="chart">{body}</div>'
