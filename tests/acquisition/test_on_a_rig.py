"""The whole room on whatever rig `--rig` names; the truth is compared where there is one."""

from __future__ import annotations

import numpy as np
import pytest

from acquisition import find_presses, record, representative, verify


@pytest.mark.parametrize("seed", [0, 11])
def test_three_buttons_are_recorded_and_told_apart(open, tmp_path, seed):
    rig = open(seed=seed)
    forces = {}
    for button in ("latch", "toggle", "push"):
        known = len(rig.simulation.truth.presses)
        recording = record(rig, button, "P01", 5, tmp_path)
        presses, truth = find_presses(recording), rig.simulation.truth.presses[known:]
        assert verify(recording.path) == ()
        assert recording.simulated
        assert len(presses) == len(truth) == 5
        mine = np.array([p.force_at_activation for p in presses])
        true = np.array([t.activation_force for t in truth])
        assert np.mean(mine) == pytest.approx(np.mean(true), rel=0.02)
        # From press to press: the recording and the plant count from different moments.
        error = np.diff([p.activation / 5000 for p in presses]) - np.diff([t.activation_time for t in truth])
        assert np.median(np.abs(error)) <= 1 / 5000
        assert sum(p.opened is not None for p in presses) == (5 if button == "push" else 0)
        forces[button] = np.mean(mine)
        press = representative([recording])
        assert press.members == 5
        assert 5 < np.abs(press.acceleration).max() < 20
    assert forces["latch"] > forces["push"] > forces["toggle"]
