"""Live control of a running emulator: the commands, the socket on which it receives them, and the client.

``control_commands.py`` declares the commands once; ``control.py`` carries them out in the loop; ``server.py``,
``endpoints.py`` and ``client.py`` bring them from another process; ``command_replay.py`` repeats those of a truth log.
"""
