"""The loop that runs devices: sampling, senses, ports, saved states, replay. Read `emulator.py` first."""
