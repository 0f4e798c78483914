"""Bounds of the numbers in a scene and in live commands.

A number outside them is a slip, such as millimetres given as metres, or would overflow during a run; no skin needs it.
"""

MAX_TIME_S = 1e6
"""The longest time that you may give: eleven days."""
STEP_RANGE_S = (1e-7, 10.0)
"""The shortest and the longest step of the simulation."""
RATE_RANGE_HZ = (1e-3, 1e6)
"""The lowest and the highest sampling rate."""
SPEED_RANGE_M_S = (1e-9, 1e3)
"""The lowest and the highest speed of a motion."""
MAX_TRAVEL_M = 10.0
"""The longest distance that a motion moves a body."""
MAX_ANGLE_RAD = 1e9
"""The largest angle that a motion turns a body by."""
MAX_DEPTH_M = 0.5
"""The largest depth that a body is pressed in."""
MAX_POSITION_M = 100.0
"""The largest coordinate of a body, from the world's origin."""
SIZE_RANGE_M = (1e-6, 3.0)
"""The smallest and the largest dimension of a body."""
MAX_RADIUS_M = 1.0
"""An upper bound of a body's radius, excluded: a ball of 1 m radius is two metres wide."""
LENGTH_UNIT = "m (6 mm is 0.006)"
"""The unit of a length, as messages give it."""
