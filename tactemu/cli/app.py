"""The application of the command line and its groups of commands. Each command imports what it runs."""

from __future__ import annotations

from tactemu.cli import attaching, compare, explaining, gadgets, infer, information, judging, logs, new, running, scenes
from tactemu.cli.benches import bench
from tactemu.cli.root import new_application
from tactemu.cli.service import service

HELP = """
A simulated tactile skin on the far end of the wire: the bytes and CAN frames of real sensors, for unmodified drivers.

\b
  tactemu devices                        list the devices
  tactemu see --demo                     watch a touched glove on a live page
  tactemu run anyskin                    emulate one on a port, with a picture
  tactemu exec anyskin -- ./driver       ... which a driver finds as hardware
  tactemu judge anyskin -- ./driver      test a driver against faults
  tactemu explain anyskin                show frames, taxels, simulated stages
  tactemu new hand.toml                  write a scene file to start from
  tactemu poke press --depth 1mm         press, move or break a running one
  tactemu tune hand.toml --rate 500      find the best setting for a rate
  tactemu dataset hand.toml --steps 99 --out readings  write Parquet
  tactemu fit rest.csv --sensor anyskin --out my.toml  fit to a recording
  tactemu check my_sensor.py:MySensor    check a device file of your own
  tactemu infer presses.mcap -o my_sensor.py  draft a device file
"""

app = new_application(HELP)
for each in (running, judging, compare, information, explaining, new, scenes, infer, logs, attaching, gadgets):
    app.add_typer(each.commands)
app.add_typer(service, name="service")
app.add_typer(bench, name="bench")
