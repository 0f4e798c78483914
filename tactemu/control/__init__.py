"""A running emulator is driven from outside: what may be done to it, the socket on which it listens, and the client.

``verbs.py`` declares the commands once; ``control.py`` carries them out in the loop; ``server.py``, ``place.py`` and
``client.py`` are the way there from another process; ``again.py`` plays what was done from a truth log.
"""
