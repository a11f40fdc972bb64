import numpy as np
import pytest

from haploop.calibration import background

RATE = 5000.0


def test_rests_are_of_unequal_lengths_and_the_same_for_the_same_names():
    found = background.rests(50, 50e3, 10, ["a drive"])
    assert found == background.rests(50, 50e3, 10, ["a drive"]) != background.rests(50, 50e3, 10, ["another"])
    assert len(set(found)) > 40 and not any(samples % 10 for samples in found)
    assert 0.25 <= min(found) / 50e3 < 0.3 and 0.45 < max(found) / 50e3 <= background.LONGEST_REST
    # At 20 Hz and above, the phases of a tone between two plays have no direction in common.
    phases = np.exp(2j * np.pi * 23.0 * np.array(background.rests(4000, RATE, 1, ["x"])) / RATE)
    assert abs(phases.mean()) < 0.1


def test_white_noise_has_no_tones():
    rng = np.random.default_rng(1)
    for plays in (1, 3, 8):
        for _ in range(100):
            records = [
                background.Record(rng.standard_normal(2000), (slice(100, 1500),)) for _ in range(plays)
            ]
            assert not len(background.tones_in(records, RATE))


@pytest.mark.parametrize("hz", [(50.0, 150.0), (49.9, 60.4), (23.7, 47.4, 71.1)])
def test_tones_are_found_and_go_on_as_they_were(hz):
    rng = np.random.default_rng(2)
    t, records, true = np.arange(8000) / RATE, [], []
    for lead in background.rests(8, RATE, 1, ["x"]):
        phases = rng.uniform(0, 2 * np.pi, len(hz))
        sizes = 10.0 ** -np.arange(len(hz))
        true.append(sum(s * np.cos(2 * np.pi * f * t + p) for s, f, p in zip(sizes, hz, phases, strict=True)))
        noise = 0.01 * rng.standard_normal(len(t))
        records.append(background.Record(true[-1] + noise, (slice(0, lead),)))
    found = background.tones_in(records, RATE)
    assert found == pytest.approx(hz, abs=0.02)
    for record, whole in zip(records, true, strict=True):
        left = whole - background.heard(background.tones_of(record, found, RATE), found, t).sum(axis=0)
        assert np.linalg.norm(left) < 0.05 * np.linalg.norm(whole)


def test_a_tone_that_does_not_last_is_not_steady_and_stays():
    rng = np.random.default_rng(3)
    t = np.arange(20000) / RATE
    records = []
    for number in range(4):
        lasting = np.cos(2 * np.pi * 100.02 * t + number)
        # Its frequency changes between the rests.
        wandering = np.cos(2 * np.pi * (300 * t + 2 * t**2) + number)
        signal = lasting + wandering + 1e-3 * rng.standard_normal(len(t))
        records.append(background.Record(signal, (slice(0, 1500), slice(16000, 20000))))
    tones = background.tones_in(records, RATE)
    kept = tones[background.steady(records, tones, RATE)]
    assert kept == pytest.approx([100.02], abs=1e-3)
    left, said = background.without_tones(records, RATE)
    assert said.steady == pytest.approx([100.02], abs=1e-3)
    for number, signal in enumerate(left):
        wandering = np.cos(2 * np.pi * (300 * t + 2 * t**2) + number)
        assert np.std(signal - wandering) < 0.02
