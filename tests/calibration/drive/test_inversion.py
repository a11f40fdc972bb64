from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import rfft, rfftfreq

from haploop.calibration.drive.inversion import Plan, max_output, min_peak, within
from haploop.calibration.spectra import fade


@pytest.fixture
def plan() -> Plan:
    """A click through two modes of opposite sign: the zero between them is in the right half plane."""
    n, rate = 6000, 5000.0
    t = np.arange(n) / rate
    since = np.maximum(t - 0.3, 0)
    f = rfftfreq(n, 1 / rate)
    s = 2j * np.pi * f
    gain = np.zeros(len(f), complex)
    for hertz, sign in ((200, 1.0), (330, -1.0), (520, 1.0)):
        w = 2 * np.pi * hertz
        gain += sign * s**2 / (s**2 + 2 * 0.01 * w * s + w**2)
    inside = (f > 150) & (f < 600)
    target = rfft(np.exp(-since / 0.02) * np.sin(2 * np.pi * 260 * since) * (t > 0.3)) * inside
    uncertain = np.full((1, 1, 1, len(f)), 1e-6 + 0j)
    window = np.zeros(n)
    window[:4500] = fade(4500, 100, 100)
    typical = float(np.median(np.abs(gain[inside]) ** 2))
    known = (f > 20) & (f < 2000)
    return Plan(target[None], gain[None, None], known, uncertain, window, typical, np.ones(1))


def test_the_inverse_begins_before_the_press(plan):
    drive, error = min_peak(plan, 0.01)
    assert error < 0.01
    before = drive[0, :1400]
    assert np.linalg.norm(before) > 0.02 * np.linalg.norm(drive)
    causal = np.where(np.arange(drive.shape[1]) < 1500, 0, drive)
    assert plan.error(causal) > 5 * error


@pytest.mark.parametrize("budget", [0.05, 0.15])
def test_a_limit_is_met_better_by_planning_than_by_regularising(plan, budget):
    plain, _ = min_peak(plan, budget)
    planned, error = max_output(plan, budget)
    assert error <= budget
    assert np.abs(planned).max() < 0.96 * np.abs(plain).max()
    assert np.all(np.abs(planned) <= plan.window * np.abs(planned).max() + 1e-12)
    # Not by being silent: clipping the plain inverse to the same peak is worse.
    clipped = np.clip(plain, -np.abs(planned).max(), np.abs(planned).max())
    assert plan.error(clipped) > error


def test_the_voltage_falls_with_each_percent_of_budget(plan):
    """In stairs of 28 %, the last bit of a computer's arithmetic decided on which of them a drive was."""
    peaks = [float(np.abs(max_output(plan, 0.1 * 1.01**k)[0]).max()) for k in range(9)]
    fallen = -np.diff(np.log(peaks))
    assert np.all(fallen > 0) and fallen.max() < 0.02, fallen


def test_steps_are_limited_by_planning_too(plan):
    free, _ = max_output(plan, 0.1)
    slew = 0.5 * float(np.abs(np.diff(free)).max() / np.abs(free).max())
    planned, error = max_output(replace(plan, slew=slew), 0.1)
    peak = float(np.abs(planned).max())
    # Steps are kept as well as the splitting converged, and no further: the caller scales what is left.
    assert np.abs(np.diff(planned)).max() < 1.25 * slew * peak
    assert error <= 0.1
    # Not by being as slow as its largest step asks of the whole: that would need a higher peak.
    assert peak < 1.9 * np.abs(free).max()


def test_a_known_drive_is_left_where_nothing_is_to_gain(plan):
    drive, _ = min_peak(plan, 0.01)
    known = replace(plan, target=plan.moved(rfft(drive)), operating_point=rfft(drive), ridge=1e-4)
    again, _ = within(known, 2 * float(np.abs(drive).max()))
    assert np.linalg.norm(again - drive) < 0.05 * np.linalg.norm(drive)


def test_uncertainty_is_part_of_the_expected_error(plan):
    drive, error = min_peak(plan, 0.05)
    assert replace(plan, covariance=1e4 * plan.covariance).error(drive) > 1.5 * error


def test_the_uncertainty_counts_from_the_drive_whose_outcome_was_measured(plan):
    drive, _ = min_peak(plan, 0.1)
    unsure = replace(plan, covariance=1e6 * plan.covariance)
    known = replace(unsure, operating_point=rfft(drive))
    exact = replace(plan, covariance=0 * plan.covariance)
    assert known.error(drive) == pytest.approx(exact.error(drive), rel=1e-9)
    assert unsure.error(drive) > 2 * known.error(drive)
    assert known.error(0.5 * drive) > exact.error(0.5 * drive)


def test_an_impossible_budget_gives_the_best_there_is(plan):
    hopeless = replace(plan, covariance=np.abs(plan.gain[None]) ** 2)
    drive, error = max_output(hopeless, 0.05)
    assert error > 0.05
    assert error <= min_peak(hopeless, 0.05)[1] * 1.001
    assert np.all(np.isfinite(drive))


def test_nothing_is_played_where_nothing_is_known(plan):
    """The drive's power beyond what was measured is 40 dB down; where it was, motion is an error."""
    f = rfftfreq(len(plan.window), 1 / 5000)
    drive, _ = max_output(plan, 0.05)
    power = np.abs(rfft(drive[0])) ** 2
    assert 10 * np.log10(power[~plan.known].sum() / power.sum()) < -40
    moved = np.abs(plan.moved(rfft(drive))[0])
    outside = plan.known & ((f < 150) | (f > 600))
    assert np.linalg.norm(moved[outside]) < 0.06 * np.linalg.norm(plan.target)


def table(shift: float = 0.0) -> np.ndarray:
    """(2 points, 3 patches, lines) of three modes: each patch drives, and each point sees, them its way."""
    s = 2j * np.pi * rfftfreq(6000, 1 / 5000.0)
    forces = np.array([[1.0, 0.4, -0.7], [0.3, -1.0, 0.5], [-0.6, 0.2, 1.0]])
    shapes = np.array([[1.0, -0.8, 0.6], [0.5, 0.9, -1.0]])
    gain = np.zeros((2, 3, len(s)), complex)
    for hertz, force, shape in zip((200.0, 330.0, 520.0), forces.T, shapes.T, strict=True):
        w = 2 * np.pi * hertz * (1 + shift)
        gain += shape[:, None, None] * force[:, None] * s**2 / (s**2 + 0.02 * w * s + w**2)
    return gain


@pytest.fixture
def several(plan: Plan) -> Plan:
    covariance = 1e-6 * np.eye(3)[None, :, :, None] * np.ones(len(plan.known), complex)
    return replace(plan, gain=table()[:1], covariance=covariance, reach=np.ones(3))


def at_both(several: Plan, second: np.ndarray) -> Plan:
    """A target for the second point as well."""
    covariance = np.repeat(several.covariance, 2, axis=0)
    return replace(several, gain=table(), target=np.array([several.target[0], second]), covariance=covariance)


def after(plan: Plan, drive: np.ndarray, shift: float) -> float:
    """Error of drives on a table whose frequencies have all moved."""
    moved = np.einsum("pl,pl->l", table(shift)[0], rfft(drive))
    missed = (plan.target[0] - moved)[plan.known]
    return float(np.linalg.norm(missed) / np.linalg.norm(plan.target))


def test_several_patches_are_planned_against_a_drift(several):
    changes = [table(shift)[0] - table()[0] for shift in (0.01, -0.01)]
    drift = sum(np.einsum("pl,rl->prl", c.conj(), c) for c in changes)[None] / 2
    plain, _ = max_output(several, 0.02)
    limit = 2 * float(np.abs(plain).max())
    steady, _ = within(replace(several, drift=drift), limit)
    plain, _ = within(several, limit)
    for shift in (0.01, -0.01):
        assert after(several, steady, shift) < 0.02
        assert after(several, plain, shift) > 0.08
    # The expected error says so beforehand.
    assert replace(several, drift=drift).error(steady) < 0.02
    assert replace(several, drift=drift).error(plain) > 0.08


def test_the_reach_of_each_patch_is_kept(several):
    free, _ = within(several, 0.2)
    reach = np.array([1.0, 0.5 * np.abs(free[1]).max() / 0.2, 1.0])
    drive, _ = within(replace(several, reach=reach), 0.2)
    assert np.all(np.abs(drive).max(axis=1) <= 0.2 * reach + 1e-12)
    assert np.abs(drive[1]).max() > 0.8 * 0.2 * reach[1]


def test_a_point_is_kept_silent_beside_one_that_moves(several):
    """Two points and three patches: the second point has a target of zero."""
    both = at_both(several, 0 * several.target[0])
    drive, _ = within(both, 1.0)
    alone, _ = within(several, 1.0)

    def loud(drive: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(both.moved(rfft(drive))[:, both.known], axis=1))

    assert loud(drive)[1] < 0.01 * loud(drive)[0]
    assert loud(alone)[1] > 0.2 * loud(alone)[0]


def test_two_points_have_presses_of_their_own(several):
    """The second is weak: its error counts over its own target, as the first's over its."""
    later = 0.05 * np.exp(-2j * np.pi * rfftfreq(6000, 1 / 5000.0) * 0.1) * several.target[0]
    both = at_both(several, later)
    drive, _ = within(both, 1.0)
    errors = np.sqrt(both.left_at(rfft(drive)) / both.wanted)
    assert np.all(errors < 0.03) and both.error(drive) == pytest.approx(np.linalg.norm(errors))
    missed = both.missed(rfft(drive))[1][both.known]
    assert np.linalg.norm(missed) < 0.03 * np.linalg.norm(later)
    assert both.at(1).error(drive) == pytest.approx(errors[1])
