"""How much a scene may ask for. Beyond these bounds a number is a slip, such as millimetres given as metres, or would
overflow on its way through a run; no skin needs it."""

MAX_TIME_S = 1e6
"""Of every time [s]: eleven days."""
STEP_RANGE_S = (1e-7, 10.0)
"""Of the simulation's step [s]."""
RATE_RANGE_HZ = (1e-3, 1e6)
"""Of sampling."""
SPEED_RANGE_M_S = (1e-9, 1e3)
"""Of a motion [m/s]."""
MAX_TRAVEL_M = 10.0
"""Of a way that a body goes [m]."""
MAX_ANGLE_RAD = 1e9
"""Of an angle that a body turns by [rad]."""
MAX_DEPTH_M = 0.5
"""That a body is pressed in [m]."""
MAX_POSITION_M = 100.0
"""From the world's origin to a body [m]."""
SIZE_RANGE_M = (1e-6, 3.0)
"""Of a body [m]; from 1 m on it may have no radius: that is a ball of two metres."""
MAX_RADIUS_M = 1.0
LENGTH_UNIT = "m (6 mm is 0.006)"
"""The unit in messages about lengths."""
