"""The two bodies of most scene files in tests: a pad that stands still, and a ball that may press it."""


def pad(*size: float, more: str = "") -> str:
    """Return the table of a fixed body `pad`: a box of full extents `size` [m], or a frame; `more` are further keys."""
    shape = f'shape = "box"\nsize = {list(size)}' if size else 'shape = "frame"'
    return f'\n[[body]]\nname = "pad"\n{shape}\nfixed = true\n{more}\n'


def ball(radius: float, position: object, more: str = "") -> str:
    """Return the table of a sphere `ball` of `radius` [m] at `position` [m]; `more` are further keys, as a motion."""
    return f'[[body]]\nname = "ball"\nshape = "sphere"\nradius = {radius}\nposition = {position}\n{more}\n'
