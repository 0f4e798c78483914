"""The complete state of a running emulator as plain data: snapshots, files of them, and their restoration."""
