"""The start of an emulator for `tactemu run`, `serve`, the pytest plugin and `judge`, and a live view in a terminal."""
