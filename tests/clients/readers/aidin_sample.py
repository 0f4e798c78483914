"""Run the example of ddoihyun/Neuromeka_AFT200-D80-C unchanged on can0, for ``tests.clients.record``.

PYTHONPATH=CHECKOUT python aidin_sample.py      its parse functions also note what they return, before it is rounded
"""

import json
import os

import sample


def main() -> None:
    """Run it twice."""
    readings = {"parse_force": [], "parse_torque": []}
    for name, noted in readings.items():
        parse = getattr(sample, name)

        def note(message, parse=parse, noted=noted):
            noted.append(parse(message))
            return noted[-1]

        setattr(sample, name, note)
    sample.INTERFACE, sample.CHANNEL = "socketcan", "can0"
    for sample.LOOP_COUNT in (200, 60):
        sample.main()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        for name, noted in readings.items():
            file.writelines(json.dumps({"as": name[6:], "values": row}) + "\n" for row in noted)


main()
