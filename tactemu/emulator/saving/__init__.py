"""The whole state of a running emulator: taken as plain data, put into a file and back, and given to another."""
