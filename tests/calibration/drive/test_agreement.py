"""Agreement of plays by hand: powers, their deviations, trends and odd plays of a few tones."""

import numpy as np
import pytest
from scipy import stats

from haploop.calibration.drive import agreement
from haploop.calibration.drive.agreement import SharedPower, error_spectra, shared_power

RATE = 5000.0


def test_the_parts_of_a_spectrum_add_up_to_the_mean_square():
    rng = np.random.default_rng(2)
    for samples in (100, 101):
        target, plays = rng.standard_normal(samples), rng.standard_normal((3, samples))
        spectra = error_spectra(plays, target)
        size = np.mean(target**2)
        np.testing.assert_allclose(
            np.sum(np.abs(spectra) ** 2, axis=1), np.mean((plays - target) ** 2, axis=1) / size
        )
    inside = agreement.lines_inside((200.0, 300.0), 5000, RATE)
    assert np.flatnonzero(inside)[[0, -1]].tolist() == [200, 300] and len(inside) == 2501


@pytest.mark.parametrize("plays", [3, 4, 8])
def test_shared_power_is_that_of_all_pairs_and_its_deviation_the_jackknife(plays):
    rng = np.random.default_rng(plays)
    spectra = rng.standard_normal((plays, 6)) + 1j * rng.standard_normal((plays, 6)) + 0.7

    def common(kept: list[int]) -> float:
        pairs = [np.vdot(spectra[i], spectra[j]).real for i in kept for j in kept if i != j]
        return float(np.mean(pairs))

    every = list(range(plays))
    left = [common([j for j in every if j != k]) for k in every] if plays > 2 else []
    found = shared_power(spectra)
    assert found.value == pytest.approx(common(every)) and found.plays == plays
    deviation = np.sqrt((plays - 1) / plays * np.sum((np.array(left) - np.mean(left)) ** 2))
    assert found.deviation == pytest.approx(deviation)
    own = np.mean(np.sum(np.abs(spectra) ** 2, axis=1))
    assert found.noise == pytest.approx((own - found.value) / plays)
    reach = stats.t.ppf(0.975, plays - 1) * deviation
    low, high = found.interval
    assert low == pytest.approx(np.sqrt(max(found.value - reach, 0)))
    assert high == pytest.approx(np.sqrt(found.value + reach))
    with pytest.raises(ValueError, match="at least three"):
        shared_power(spectra[:2])


def test_a_negative_power_has_the_root_zero():
    found = SharedPower(-0.01, 0.001, -1e-9, 4)
    assert (found.root, found.floor) == (0.0, 0.0) and found.interval == (0.0, 0.1)
    assert SharedPower(0.04, 0.0, 0.01, 4).root == 0.2 and SharedPower(0.04, 0.0, 0.01, 4).floor == 0.1


@pytest.mark.parametrize(
    ("deviation", "value"), [(0.02, 0.06), (0.004, 0.045), (0.01, 0.03), (1e-5, 0.03), (0.5, 0.041)]
)
def test_the_plays_needed_leave_out_the_limit_first(deviation, value):
    reaches = {n: stats.t.ppf(0.975, n - 1) * deviation * np.sqrt(5 / n) for n in range(6, 65)}
    expected = next((n for n, reach in reaches.items() if abs(value - 0.04) > reach), None)
    assert agreement.plays_needed(SharedPower(value, deviation, 0.0, 5), 0.2) == expected


def test_sixty_four_plays_are_the_most():
    reaches = [stats.t.ppf(0.975, n - 1) * 0.01 * np.sqrt(5 / n) for n in (63, 64, 65)]
    for value, expected in ((np.mean(reaches[:2]), 64), (np.mean(reaches[1:]), None)):
        assert agreement.plays_needed(SharedPower(0.04 + float(value), 0.01, 0.0, 5), 0.2) == expected


@pytest.mark.parametrize("lines", [1, 3, 30])
def test_a_trend_is_significant_by_an_f_test_against_the_other_contrasts(lines):
    rng = np.random.default_rng(lines)
    plays, along = 6, np.arange(6) - 2.5
    quiet = (rng.standard_normal((plays, lines)) + 1j * rng.standard_normal((plays, lines))) * 1e-3

    def significant(slope: float) -> tuple[bool, np.ndarray]:
        spectra = quiet + slope * along[:, None]
        around = (np.abs(spectra - spectra.mean(axis=0)) ** 2).sum(axis=0)
        changed = (np.abs(along @ spectra) ** 2).sum() / (along @ along)
        noise = (around.sum() - changed) / (plays - 2)
        freedom = 2 * around.sum() ** 2 / (around**2).sum()
        limit = stats.f.ppf(1 - 1e-5, freedom, freedom * (plays - 2))
        return bool(changed > noise * limit), spectra

    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if significant(middle)[0] else (middle, high)
    assert agreement.trend(significant(low * 0.999)[1]) == 0.0
    assert agreement.trend(significant(high * 1.001)[1]) > 0.0


def test_a_trend_is_the_change_from_first_to_last_and_not_of_noise():
    rng = np.random.default_rng(3)

    def spectra(slope: float, plays: int = 7) -> np.ndarray:
        along = np.arange(plays)[:, None] / (plays - 1)
        quiet = rng.standard_normal((plays, 40)) + 1j * rng.standard_normal((plays, 40))
        return np.asarray(1e-3 * quiet + slope * along * np.eye(40)[:1])

    assert agreement.trend(spectra(0.5)) == pytest.approx(0.5, rel=0.02)
    assert [agreement.trend(spectra(0.0)) for _ in range(50)] == [0.0] * 50


def test_an_odd_play_is_three_times_as_far_as_the_others():
    spectra = np.zeros((5, 4), complex)
    spectra[:, 0] = [0.0, 1.0, 2.0, 3.0, 4.0]
    assert agreement.odd_play(spectra) == (0, 0.0)
    spectra[1, 0] = 0.01  # two that are alike by chance make no other one odd
    assert agreement.odd_play(spectra) == (0, 0.0)
    spectra[1, 0] = 1.0
    spectra[1, 1] = 2.8  # its nearest is sqrt(1 + 2.8^2) = 2.97 away, the others' 1 or 2
    assert agreement.odd_play(spectra) == (0, 0.0)
    spectra[1, 1] = 6.1
    number, apart = agreement.odd_play(spectra)
    assert number == 2 and apart == pytest.approx(np.sqrt(1 + 6.1**2))
