"""TAMS tactile sensor array: 6 x 6 taxels of 10 bits, up to three on the fingers of a Robotiq gripper.

Wire: serial, 115200 8N1. Device to host only: in each cycle one ``FRAME`` of every sensor, in the order of the numbers.

The 36 values of a sensor stand bit after bit, each with its high bit first, and fill 45 bytes exactly. A push lowers
them. The reader begins behind the first 00, which may stand amid the values of a strong push; it then takes a value for
a number, and reads wrong values if a sensor has it, else skips to the next 00.

Evidence: the reader, run, and the programs that draw what it reads.

Try it: ``tactemu run tams_array``, then ``SensorReader`` with ``params_diana.yaml`` and ``PORT`` as ``serial_port``.
"""

from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, CountsPerNewton, Device, Frame, Option, Serial, Transmissions, fact_table, grid_layout, on_fingers,
)  # fmt: skip

REPOSITORY = "TAMS-Group/tams_tactile_sensor_array@95e551b"
READER = f"{REPOSITORY} src/tams_tactile_sensor_array/tactile_sensor_array_standalone.py"
TAXELS, BITS = 36, 10
FINGERS = ("middle", "index", "ring")
FRAME = Frame("""
    frame of one sensor, row by row
    0     u1              number   of the sensor, from 1
    1     bytes x 45      touch    10 bits per taxel, the high bit first
    46    00              end
""")


class TamsArray(Device):
    """Sensors that stream, one after the other."""

    name = "tams_array"
    title = "TAMS tactile sensor array, 6x6 on each finger"
    kind = "fingertip"
    ports = (Serial(baud=115_200),)
    rate_hz = 50.0
    evidence = ("driver",)
    sources = (READER, f"{REPOSITORY} config/params.yaml", f"{REPOSITORY} config/params_diana.yaml")
    judge = REPOSITORY
    facts = fact_table(f"""
        stated touch: 36 values of 10 bits, highest bit first @ {READER}:60-63
        stated touch: the reader draws them as an image of 6 rows, one after the other, the first at the top @
            {REPOSITORY} scripts/tactile_visualizer.py:34-42
        stated touch: a push lowers the values: its strength is 1024 minus the value @ {REPOSITORY}
            scripts/evaluation/extract_csv.py:19
        stated touch: the reader draws taxels 3.8 mm apart @ {REPOSITORY} scripts/visualize_markers.py:100-103
        assumed touch: 1023 at rest, 100 counts/N, linear; the image is seen from outside @ {REPOSITORY}, all files
        stated configuration: 115200 baud @ {REPOSITORY} config/params_diana.yaml:5
        stated configuration: a frame has the number of its sensor, the values and one more byte @ {READER}:38-58, 85
        stated configuration: a byte 00 ends a frame @ {READER}:66-73
        stated configuration: the sensors have the numbers 1 and 2 @ {REPOSITORY} config/params_diana.yaml:8-18
        stated configuration: sensor 1 on the middle finger, 2 and 3 on the others
            @ {REPOSITORY} config/params.yaml:9-24
        assumed configuration: sensors 1 and 2 are on the links index and ring; the places of these links @
            {REPOSITORY}, all files
        assumed timing: 50 cycles a second from power-up on; frames follow one another without a gap @ {REPOSITORY}, all
            files
    """)

    def __init__(
        self,
        *,
        sensors: Annotated[int, Option("number of sensors", low=1, high=len(FINGERS))] = 2,
        counts_per_newton: CountsPerNewton = 100.0,
        baseline: Annotated[int, Option("counts of a taxel at rest", low=1, high=1023)] = 1023,
    ):
        self.layout = on_fingers(grid_layout(6, 6, 0.0038), *FINGERS[:sensors])
        self.columns = (
            Column(name="touch", low=0, high=1023, rest=baseline, assumed_per_unit=counts_per_newton, push=-1),
        )

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame of each sensor."""
        values = np.asarray(self.layout.on_wire(self.counts)).astype(">u2").reshape(-1, TAXELS, 1)
        bits = np.unpackbits(values.view(np.uint8), axis=-1)[..., -BITS:].reshape(len(values), -1)
        touch = np.packbits(bits, axis=-1)
        return [FRAME.pack(number=number, touch=row.tobytes()) for number, row in enumerate(touch, 1)]
