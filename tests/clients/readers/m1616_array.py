"""Run the reader's ``main.py``, which opens COM10 and draws, for 40 frames: ``m1616_array.py PORT``, beside it."""

import json
import os
import runpy
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.image

rows = open(os.environ["TACTEMU_ROWS"], "a", buffering=1)
draw = matplotlib.image.AxesImage.set_data
drawn = 0


def set_data(image, values):
    """Note what the reader draws; the first picture, of zeros, is its own."""
    global drawn
    draw(image, values)
    if drawn:
        rows.write(json.dumps({"as": "touch", "values": values.ravel().tolist()}) + "\n")
    drawn += 1
    if drawn > 40:
        raise SystemExit


matplotlib.image.AxesImage.set_data = set_data
os.symlink(sys.argv[1], "COM10")
runpy.run_path("main.py")
