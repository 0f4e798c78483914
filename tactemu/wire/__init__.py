"""Between devices and port: the pace of the line, the order of its senders, and its faults."""
