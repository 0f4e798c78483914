"""The live page, and exports of logs to the formats of other viewers."""
