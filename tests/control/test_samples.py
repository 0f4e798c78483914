"""A sample is the same object from ``serve`` and from ``connect``."""

import numpy as np
import pytest

import tactemu as tt


def test_a_sample_is_the_same_object_from_both_ends_and_never_none(monkeypatch, runtime_folder):
    with tt.serve("anyskin", "memory:", clock="lockstep", name="skin") as dev, tt.connect("skin") as running:
        here, there = dev.sample(), running.sample()
        assert type(here) is type(there) and there.device == "anyskin" and there.number == here.number
        assert np.allclose(here.measured, there.measured) and np.allclose(here.counts, there.counts)
        monkeypatch.setattr(type(dev.truth), "latest", lambda *_: None)
        for end in (dev, running):
            with pytest.raises(
                tt.TactemuError, match="skin 'anyskin' has not been sampled yet; wait, or step the time"
            ):
                end.sample()
