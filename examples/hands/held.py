"""A success test: the grasped object stays in the hand, unbroken, after its table has been moved away.

    tactemu judge examples/hands/linker_l6.toml --success examples/hands/held.py -- \\
      python examples/hands/grasp_linker_l6.py {channel} {interface} --seconds 60
"""

import time


def success(dev) -> bool:
    """Return True if the object of the served scene is still at its height; a broken object is out of reach."""
    time.sleep(5)  # the hand has grasped the object by then
    dev.move((0, 0, -0.2), body="table", speed=0.3)
    time.sleep(2)
    return 0.06 < dev.state()["bodies"]["object"]["position"][2] < 0.08
