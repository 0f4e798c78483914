"""The kernels that list, sort and search probes on a GPU, run on a CPU."""

import hashlib

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.sensors.probes import near_list, strips


def readings(**options):
    """Readings of probes beside two meshes and a ball, whose poses differ between environments."""
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(tt.Box(size=(0.1, 0.1, 0.01)), fixed=True)
    bodies = [
        scene.add_body(tt.Mesh(source=trimesh.creation.icosphere(3, radius=0.01))),
        scene.add_body(tt.Mesh(source=trimesh.creation.box((0.01, 0.02, 0.03)))),
        scene.add_body(tt.Sphere(radius=0.006)),
    ]
    grid = np.stack([*np.meshgrid(*[np.linspace(-0.02, 0.02, 12)] * 2), np.full((12, 12), 0.005)], -1)
    model = tt.ContactDepthProbe(positions=grid, radius=0.003, **options)
    skin = scene.add_sensor(model, link=link)
    sim = scene.build(40)
    rng = np.random.default_rng(0)
    for body in bodies:
        sim.set_pose(body, position=rng.uniform(-0.02, 0.02, (40, 3)) * [1, 1, 0.1] + [0, 0, 0.012],
                     quaternion=rng.normal(size=(40, 4)))  # fmt: skip
    for _ in range(2):  # the second step must not see the list of the first
        sim.step()
    return skin.read()


NOISY = {"electronics": tt.ElectronicsOptions(noise=1e-4)}


@pytest.mark.parametrize("options", [NOISY, {"depth_query": "ray"}], ids=["nearest surface", "ray"])
def test_listed_probes_read_what_others_read(options, monkeypatch):
    expected = readings(**options)
    recorded = []

    def listed(site, formula, task):
        recorded.append(formula)
        return near_list.record_listed(site, formula, task)

    monkeypatch.setattr(strips, "_record", listed)
    found = readings(**options)
    assert recorded and expected.any()
    assert hashlib.sha256(found.tobytes()).digest() == hashlib.sha256(expected.tobytes()).digest()


def test_the_sorted_list_holds_each_probe_once_and_neighbours_together(monkeypatch):
    lists = []
    sort = near_list.sort_probes

    def kept(kernel, dim, inputs, outputs, device, **options):
        lists.extend(inputs if kernel is sort else [])
        return record(kernel, dim, inputs, outputs, device, **options)

    record = near_list.record
    monkeypatch.setattr(near_list, "record", kept)
    monkeypatch.setattr(strips, "_record", near_list.record_listed)
    readings()
    (near,) = lists
    count = int(near.n.numpy()[0])
    probes, cells, order = (getattr(near, name).numpy()[:count] for name in ("probes", "cells", "sorted"))
    assert count > 100 and sorted(order) == sorted(probes) and len(set(order)) == count
    cell_of = dict(zip(probes, cells))
    changes = np.count_nonzero(np.diff([cell_of[probe] for probe in order]))
    assert changes == len(set(cells)) - 1  # the probes of a cell are next to each other
