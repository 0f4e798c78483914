"""Only what the scene requires is built, compiled and launched."""

import subprocess
import sys

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.geometry.shapes import mesh_query
from tactemu.sensors.sensor import reading_array
from tests.sensors.rig import scene_with

COUNT = """
import warp as wp
wp.config.quiet = True
from warp._src import context
from tactemu.plan import launches as recorded
launches, modules = [], set()
ready, load = recorded._ready, context.Module.load
def ready_and_counted(command):
    launch = ready(command)
    return lambda: (launches.append(command.kernel.key), launch())
recorded._ready = ready_and_counted
def counted(self, *a, **k):
    modules.add(self.name)
    return load(self, *a, **k)
context.Module.load = counted
import tactemu as tt
grid = [[[x * 2e-3, y * 2e-3, 0.0] for x in range(4)] for y in range(3)]
scene = tt.Scene()
link = scene.add_body(tt.Box(size=(0.02, 0.02, 0.02)), position=(0, 0, -0.01), fixed=True)
scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.009))
{sensors}
sim = scene.build()
sim.step()
sim.step()
launches.clear()
sim.step()
print(len(launches), len(modules), ",".join(stage.name for stage in sim.plan.stages))
"""
BARE = "scene.add_sensor(tt.ContactDepthProbe(positions=grid), link=link)"
FULL = """
spoilt = dict(
    electronics=tt.ElectronicsOptions(noise=1e-6, bias=1e-6, random_walk=1e-6, delay=2e-3),
    imperfections=tt.ImperfectionOptions(
        hysteresis_strength=0.5, dead_taxel_probability=0.1, gain_range=(0.9, 1.1),
        radius_noise=1e-5,
    ),
)
for kind in (tt.ContactProbe, tt.ContactDepthProbe, tt.KinematicTaxel, tt.ElastomerTaxel, tt.ProximityTaxel):
    scene.add_sensor(kind(positions=grid, sense=1, **spoilt), link=link, name=kind.__name__)
"""


def counted(sensors: str) -> tuple[int, int, list[str]]:
    code = COUNT.replace("{sensors}", sensors)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stderr
    launches, modules, stages = done.stdout.strip().splitlines()[-1].split(" ", 2)
    return int(launches), int(modules), stages.split(",")


def test_a_bare_scene_is_two_launches_of_two_kernels():
    launches, modules, stages = counted(BARE)
    assert (launches, modules) == (2, 2)
    assert stages == ["relative poses", "ContactDepthProbe0: contact depth"]


def test_a_full_scene_is_counted():
    launches, modules, stages = counted(FULL)
    assert len(stages) >= 15
    assert launches <= 50 and modules <= 30, (launches, modules, stages)


def test_velocities_are_computed_only_for_who_asks():
    still = {"normal_damping": 0.0, "shear_scalar": 0.0, "twist_scalar": 0.0}
    for options, expected in ((still, False), ({**still, "shear_scalar": 1.0}, True)):
        sim, _body, _skin = scene_with(tt.Sphere(radius=0.01), tt.KinematicTaxel(**options))
        assert ("velocities for skin (KinematicTaxel shear)" in str(sim.plan)) == expected
        assert (sim._poses._velocity.size > 0) == expected


def test_without_imperfections_the_measured_branch_is_the_truth():
    sim, body, skin = scene_with(tt.Sphere(radius=0.01), tt.ContactDepthProbe(radius=1e-3))
    assert reading_array(skin) is reading_array(skin, ground_truth=True)
    biased = tt.ContactDepthProbe(radius=1e-3, electronics=tt.ElectronicsOptions(bias=1e-3))
    sim, body, skin = scene_with(tt.Sphere(radius=0.01), biased)
    sim.set_pose(body, position=(0, 0, 0.009))
    sim.step()
    assert skin.read() - skin.read_ground_truth() == pytest.approx(1e-3, abs=1e-9)


def test_the_plan_prints_reasons_and_measured_costs():
    sim, _body, _skin = scene_with(tt.Sphere(radius=0.01), tt.ContactDepthProbe())
    clock = iter(range(0, 10**9, 2000))
    costs = sim.plan.time_stages(lambda: next(clock), repeats=3)
    assert costs == {"relative poses": 2.0, "skin: contact depth": 2.0}
    table = str(sim.plan).splitlines()
    assert table[0].split() == ["stage", "µs", "why"]
    assert "2.0  poses of all bodies" in table[1] and "ContactDepthProbe reads depth" in table[2]


def test_a_mesh_that_no_sensor_feels_is_never_loaded():
    scene = tt.Scene()
    link = scene.add_body(fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.009))
    scene.add_body(tt.Mesh(source="there is no such file.stl"))
    skin = scene.add_sensor(tt.ContactDepthProbe(sense=ball), link=link)
    scene.build().step()
    assert skin.read()[0] > 0


def test_bodies_that_share_a_mesh_share_its_hierarchy(monkeypatch):
    built = []
    build = mesh_query.build_query
    monkeypatch.setattr(mesh_query, "build_query", lambda *args: built.append(args) or build(*args))
    ball = tt.Mesh(source=trimesh.creation.icosphere(2, radius=0.01))
    scene = tt.Scene()
    link = scene.add_body(fixed=True)
    for x in (-0.02, 0.0, 0.02):
        scene.add_body(ball, position=(x, 0, 0.009))
    line = [[x, 0, 0] for x in (-0.02, 0.0, 0.02)]
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=line, radius=1e-3), link=link)
    scene.build().step()
    assert len(built) == 1 and skin.read() == pytest.approx(2e-3, abs=5e-5)


def test_a_scene_without_sensors_steps():
    scene = tt.Scene(dt=0.5)
    scene.add_body(tt.Sphere(radius=0.01))
    sim = scene.build()
    sim.step()
    assert sim.time_ns == 500_000_000 and [stage.name for stage in sim.plan.stages] == ["time"]


def test_an_empty_scene_steps():
    sim = tt.Scene(dt=1e-3).build(3)
    sim.step()
    sim.reset()
    assert sim.time_ns == 0


def test_two_skins_on_two_links_feel_each_other():
    scene = tt.Scene()
    lower = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True)
    upper = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), position=(0, 0, 0.009))
    options = {"positions": [[0, 0, 0.005]], "radius": 1e-3}
    one = scene.add_sensor(tt.ContactDepthProbe(**options), link=lower)
    options["positions"] = [[0, 0, -0.005]]
    other = scene.add_sensor(tt.ContactDepthProbe(**options, normals=(0, 0, -1)), link=upper)
    scene.build().step()
    assert one.read() == pytest.approx(2e-3, abs=1e-9) and np.array_equal(one.read(), other.read())
