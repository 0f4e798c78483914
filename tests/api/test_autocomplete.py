"""What an interactive shell offers after ``sim.``, ``skin.`` and ``dev.``: what users call, no internals."""

import tactemu as tt

PUBLIC = """
    advance_to batched bind_poses bodies check clone close device dt dt_ns env_time n_envs names plan pose pose_array
    prepare_restore release reset sensors set_pose state step step_count time time_ns
""".split()

SENSOR = """
    arrays convention ground_truth_arrays host_array imperfections layout link link_pose model n_taxels name names
    normals on_skin positions quantities quantity radii read read_ground_truth set set_bias set_dead set_gain set_jitter
    set_noise set_radius_noise set_random_walk set_resolution set_saturation_range touching transducers unit
""".split()
COMMANDS = """
    dead describe fault give_back hang inject_event mend move press release reset restore sample save set set_lines
    set_pose state stats step unplug wait
""".split()
SERVED = """
    can device emulator fork host_port in_loop port ports running simulation start stop truth wait_for_driver
""".split()


def public(thing) -> list[str]:
    return sorted(name for name in dir(thing) if not name.startswith("_"))


def test_a_sensor_offers_what_is_public():
    scene = tt.Scene()
    skin = scene.add_sensor(tt.KinematicTaxel(), link=scene.add_body(fixed=True))
    assert public(skin) == SENSOR
    scene.build()
    assert public(skin) == SENSOR
    assert public(skin.arrays) == ["bad_poses", "contacts", "force", "packed", "torque"]


def test_a_served_device_offers_the_commands_and_what_it_is():
    assert public(tt.serve("anyskin", "memory:")) == sorted([*COMMANDS, *SERVED])


def test_a_connection_offers_the_same_commands():
    with tt.serve("anyskin", "memory:", clock="lockstep", name="autocomplete"), tt.connect("autocomplete") as running:
        assert set(public(running)) - set(COMMANDS) == {"about", "close", "watch"}
        assert set(COMMANDS) <= set(public(running))


def test_a_simulation_offers_what_is_public():
    assert public(tt.Scene().build()) == PUBLIC


def test_one_of_several_devices_offers_the_same_verbs():
    sims = tt.Scene().build_split(2, ["cpu", "cpu"])
    own = {name for name in dir(sims) if not name.startswith("_")}
    assert own - set(PUBLIC) == {"parts", "read", "sensor", "starts"}
