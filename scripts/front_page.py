#!/usr/bin/env python3
"""Make what the front page of the site shows, each from a real run: the live page, a report card, the trade-off.

usage: scripts/front_page.py [live] [card] [trade]      default: all three

``live`` records the scene of the live page for viser's player, in the times of the simulation (extra ``web``). ``card``
judges the first driver of docs/tutorial.md. ``trade`` draws the figures of docs/accuracy.md again, without measuring.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

DOCS = ROOT / "docs"
PICTURES = DOCS / "pictures"
SCENE, SECONDS, RATE_HZ = "tactemu/scene/demo.toml", 8.0, 20.0
"""What is recorded, for how long, and the pictures in a second."""
JUDGE = "judge optoforce --seed 1 --budget 90s --html card.html -- python driver.py {port}"
FRONT = ["total force"]
"""The metric of the picture of the front page."""


def live() -> None:
    """Write live.viser, and live.json with the camera and the legend."""
    import viser

    import tactemu as tt
    from tactemu.control.client import connect
    from tactemu.view.page.bodies import Scene
    from tactemu.view.page.camera import Cameras
    from tactemu.view.page.feed import DescribedRun, page_state

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with tt.serve(str(ROOT / SCENE), name="front-page"), connect("front-page") as connection:
        run = DescribedRun(connection.describe())
        scene = Scene(server, run)
        recording, last_s, end_s = server.get_scene_serializer(), None, 0.0
        for state in connection.watch(RATE_HZ, arrays=True):
            now = page_state(state, run)
            if last_s is None:
                last_s, end_s = now.t_s, now.t_s + SECONDS
            recording.insert_sleep(max(now.t_s - last_s, 0.0))
            last_s = max(now.t_s, last_s)
            scene.draw(now)
            server.flush()
            if now.t_s >= end_s:
                break
        (PICTURES / "live.viser").write_bytes(recording.serialize())
        Cameras(server, scene.seen).place_first()
        camera = server.initial_camera
        about = {"position": camera.position, "look_at": camera.look_at, "fov": [camera.fov]}
    server.stop()
    about = {name: [round(float(each), 4) for each in place] for name, place in about.items()}
    (PICTURES / "live.json").write_text(json.dumps({**about, "legend": scene.legend()}) + "\n", encoding="utf-8")


def card() -> None:
    """Write card.html, without the paths of this machine."""
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    driver = re.findall(r"```python driver\.py\n(.*?)```", page, re.DOTALL)[0]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "driver.py").write_text(driver, encoding="utf-8")
        command = [sys.executable, "-m", "tactemu", *JUDGE.split()]
        subprocess.run(command, cwd=folder, env={"PYTHONPATH": str(ROOT)}, check=False)
        text = (Path(folder) / "card.html").read_text(encoding="utf-8")
        text = re.sub(r"/[\w/.#-]+/driver\.py", "driver.py", text.replace(sys.executable, "python"))
    (PICTURES / "card.html").write_text(text, encoding="utf-8")


def trade() -> None:
    """Write accuracy.svg and trade.svg."""
    from tactemu.tune.trade.picture import draw
    from tactemu.tune.trade.report import read_table

    found = {"summary": read_table((DOCS / "accuracy.md").read_text(encoding="utf-8"))}
    draw(found, PICTURES / "accuracy.svg")
    draw(found, PICTURES / "trade.svg", FRONT, command="", size=(4.0, 3.5))


def main() -> None:
    """Make what the command line names."""
    parts = {"live": live, "card": card, "trade": trade}
    for name in sys.argv[1:] or parts:
        parts[name]()


if __name__ == "__main__":
    main()
