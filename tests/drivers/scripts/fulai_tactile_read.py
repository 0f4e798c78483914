"""fulai-tactile: who the glove is, and 200 frames."""

import json
import sys

from fulai_tactile import Frame, Glove, GloveConfig, ReadStatus

port = sys.argv[1]
with Glove() as glove:
    assert glove.configure(GloveConfig(device_id="G-001")) and glove.open(port), glove.last_error()
    frames, frame = [], Frame()
    while len(frames) < 200:
        assert glove.read(frame, 2000) == ReadStatus.OK, glove.last_error()
        frames.append(list(frame.raw_values))
    identity, stats = glove.device_identity(), glove.stats()
    cells = [[zone.transport_offset, zone.rows, zone.columns, *zone.cell_map] for zone in glove.zone_layout()]
print(
    json.dumps(
        {
            "identity": [identity.detected, identity.firmware, identity.hardware, identity.hand.name],
            "malformed": stats.malformed_frames,
            "cells": cells,
            "frames": frames,
        }
    )
)
