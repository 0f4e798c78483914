"""Episodes of environments: each counts steps and time from its own reset."""

import pytest

import tactemu as tt


def scene() -> tt.Scene:
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), name="pad")
    scene.add_sensor(tt.ContactDepthProbe(probe_local_pos=[(0.0, 0.0, 0.005)]), link=pad)
    return scene


@pytest.mark.parametrize("threads", [1, 2])
def test_each_environment_counts_from_its_own_reset(threads):
    sim = scene().build(3, threads=threads)
    for k in range(5):
        sim.step()
        if k == 1:
            sim.reset([2])

    def counts():
        context = sim.context
        steps = (context.step.numpy() - context.began_step.numpy()).tolist()
        return steps, (context.time_ns.numpy() - context.began_ns.numpy()).tolist()

    assert counts() == ([5, 5, 3], [5_000_000, 5_000_000, 3_000_000])
    state = sim.state()
    sim.reset()
    assert counts() == ([0, 0, 0], [0, 0, 0])
    sim.prepare_restore(state)()
    assert counts() == ([5, 5, 3], [5_000_000, 5_000_000, 3_000_000])
