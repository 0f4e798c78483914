"""What an interactive shell offers after ``sim.``: what users call, and nothing of the inside."""

import tactemu as tt

PUBLIC = """
    advance_to batched bind_poses bodies check clone close context device dt dt_ns env_time n_envs names plan pose
    pose_array posers prepare_restore release reset sensors set_pose state step step_count time time_ns
""".split()


def test_a_simulation_offers_what_is_public():
    sim = tt.Scene().build()
    assert sorted(name for name in dir(sim) if not name.startswith("_") and name != "TRANSIENT_FIELDS") == PUBLIC


def test_one_of_several_devices_offers_the_same_verbs():
    sims = tt.Scene().build_split(2, ["cpu", "cpu"])
    own = {name for name in dir(sims) if not name.startswith("_")}
    assert own - set(PUBLIC) == {"parts", "read", "sensor", "starts"}
