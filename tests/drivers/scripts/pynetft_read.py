"""pynetft: read the page, start, bias, then so many readings; host, RDT port, HTTP port, bias, count."""

import json
import sys

from pynetft import Client, Config

host, rdt_port, http_port, bias, count = sys.argv[1], *map(int, sys.argv[2:])
config = Config(sensor_host=host, rdt_port=rdt_port, http_port=http_port, receive_timeout=1.0)
samples = []
with Client(config, queue_size=65_536) as client:
    assert client.wait_for_first_sample(5)
    if bias:
        client.bias()
    for sample in client.samples(timeout=5):
        samples.append(sample)
        if len(samples) >= count:
            break
    health = client.health()
calibration = health.sensor_configuration.calibration
got = {
    "raw": [list(each.raw_wrench) for each in samples],
    "wrench": [list(each.wrench) for each in samples],
    "sequences": [each.rdt_sequence for each in samples],
    "samples": [each.ft_sequence for each in samples],
    "status": sorted({each.status for each in samples}),
    "product": health.sensor_configuration.product_name,
    "units": [calibration.force_unit, calibration.torque_unit],
    "counts": [calibration.counts_per_force_unit, calibration.counts_per_torque_unit],
    "lost": health.lost_count,
    "duplicate": health.duplicate_count,
    "late": health.out_of_order_count,
    "malformed": health.malformed_count,
}
print(json.dumps(got))
