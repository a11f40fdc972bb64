"""The coherence that the page Table shows while something is played."""

import numpy as np
from scipy.signal import chirp, lfilter

from haploop.console.server.follower import driven_coherence

RATE = 5000.0
TIMES = np.arange(2 * int(RATE)) / RATE


def test_a_sweep_is_judged_where_it_has_been():
    """Two of ten seconds of a sweep: most of the band was not driven yet, and says nothing."""
    drive = chirp(TIMES, 20.0, 2.0, 140.0)
    noise = np.random.default_rng(0).normal(0, 1e-3, len(TIMES))
    found = driven_coherence(drive, lfilter([0.1], [1, -0.9], drive) + noise, RATE)
    assert found is not None and found > 0.95
    random = np.random.default_rng(1)
    found = driven_coherence(random.normal(size=len(TIMES)), random.normal(size=len(TIMES)), RATE)
    assert found is not None and found < 0.2
    assert driven_coherence(TIMES[:100], TIMES[:100], RATE) is None
