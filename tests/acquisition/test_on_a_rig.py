"""The whole room on whatever rig `--rig` names; the truth is compared where there is one."""

import numpy as np
import pytest

from haploop.acquisition import find_presses, record, representative, verify

BUTTONS = ("latch", "toggle", "push")


@pytest.mark.long
def test_three_buttons_are_recorded_and_told_apart(open, tmp_path):
    rig = open(seed=11)
    forces = {}
    for button in BUTTONS:
        recording, presses, _ = pressed(rig, button, "P01", 4, tmp_path)
        assert verify(recording.path) == ()
        assert recording.simulated
        forces[button] = np.mean([p.force_at_activation for p in presses])
        press = representative([recording])
        assert press.members == 4
        assert 5 < np.abs(press.acceleration).max() < 20
    assert forces["latch"] > forces["push"] > forces["toggle"]


@pytest.mark.long
def test_presses_are_found_as_they_were_whatever_the_seed(open, tmp_path, full):
    """`--full`: 20 rigs, each with a study of twelve participants, three buttons and ten presses."""
    seeds, participants, presses = (20, 12, 10) if full else (2, 1, 3)
    instants, forces, stages = [], [], []
    for seed in range(100, 100 + seeds):
        rig = open(seed=seed)
        for number in range(participants):
            for button in BUTTONS:
                out = tmp_path / str(seed)
                recording, found, truth = pressed(rig, button, f"P{number + 1:02}", presses, out)
                instants += since_first(found, truth, "activation", "activation_time")
                mine = np.array([p.force_at_activation for p in found])
                forces += list(mine / [t.activation_force for t in truth] - 1)
                if button == "latch":
                    # The model's first click, which no other part of the product may look at.
                    early = [(t.activation_time - t._clicks[0][0]) * recording.rate_hz for t in truth]
                    stages += [p.activation - p.first_stage - e for p, e in zip(found, early, strict=True)]
                if button == "push":
                    instants += since_first(found, truth, "opened", "release_time")
                recording.path.unlink()
    assert np.median(np.abs(instants)) <= 1
    assert abs(np.mean(forces)) < 0.01
    assert np.quantile(np.abs(forces), 0.95) < 0.02
    assert np.median(np.abs(stages)) < 5  # samples: 1 ms
    print(
        f"{len(forces)} presses: instant {np.median(np.abs(instants)):.2f} samples (median), "
        f"{np.max(np.abs(instants)):.2f} at most; force {np.mean(forces):+.2%}, "
        f"{np.max(np.abs(forces)):.2%} at most; first stage {np.median(np.abs(stages)):.1f} samples, "
        f"{np.max(np.abs(stages)):.1f} at most"
    )


def pressed(rig, button, participant, count, out):
    """A recording, its presses, and the truth about them: as many, of the kind that the button makes."""
    known = len(rig.simulation.truth.presses)
    recording = record(rig, button, participant, count, out)
    presses, truth = find_presses(recording), rig.simulation.truth.presses[known:]
    assert len(presses) == len(truth) == count
    assert all((p.first_stage is not None) == (button == "latch") for p in presses)
    assert all((p.opened is not None) == (button == "push") for p in presses)
    return recording, presses, truth


def since_first(presses, truth, mine, theirs):
    """Errors (samples): the recording and the plant count from different moments."""
    found = np.array([getattr(p, mine) for p in presses])
    true = 5000 * np.array([getattr(t, theirs) for t in truth])
    error = found - true
    return list(error - np.median(error))
