"""The start-up that `tactemu run`, `serve`, the pytest plugin and `judge` share, and a live view in a terminal."""
