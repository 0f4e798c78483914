"""Whether what a hand has grasped stays in it, and whole, once its table has gone.

    tactemu judge examples/hands/linker_l6.toml --success examples/hands/held.py -- \\
      python examples/hands/grasp_linker_l6.py {channel} {interface} --seconds 60
"""

import time


def success(dev) -> bool:
    """``dev`` is what ``tactemu.serve`` gives; what has broken is nowhere."""
    time.sleep(5)  # by then it has been grasped
    dev.move((0, 0, -0.2), body="table", speed=0.3)
    time.sleep(2)
    return 0.06 < dev.state()["bodies"]["object"]["position"][2] < 0.08
