"""The loop that runs devices: sampling, sensing, ports, saved states, replay. Read `emulator.py` first."""
