from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.signal import StateSpace, freqresp, sosfreqz

from benchmarks.fits import auto_fit, found
from benchmarks.synthetic_responses import Case, beam, generator, response_of
from benchmarks.synthetic_responses import plate as plate_of
from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import Model, Response, calibrate, fit
from haploop.calibration.model import apart, rational
from haploop.calibration.model.projection import Lines, Projection
from haploop.instruments import open_rig
from tests.raising import raises

BEAM = Path(__file__).parents[2] / "data" / "beam_accelerance_point1.txt"


def plate(
    seed: int, damping_scale: float = 1.0, snr_db: float = 37.0, lines: int = 1228
) -> tuple[Response, np.ndarray, float]:
    """Twelve modes from 40 to 700 Hz, damped by 0.5 to 2 %, the strongest at 263.5 Hz.

    Returns the response as measured, the true velocity, and the strongest mode's frequency.
    """
    rng = np.random.default_rng(seed)
    natural = np.linspace(45, 690, 12) + rng.uniform(-15, 15, 12)
    natural[4] = 263.5 + rng.uniform(-1, 1)
    damping = rng.uniform(0.005, 0.02, 12) * damping_scale
    residues = rng.uniform(0.2, 0.6, 12) * rng.choice([-1, 1], 12)
    residues[4] = 1.5
    # Residues per decay, so that they are the peaks' heights.
    strength = residues * 2 * damping * 2 * np.pi * natural
    f = np.linspace(20, 620, lines)
    s, w = 2j * np.pi * f[:, None], 2 * np.pi * natural
    truth = (strength * s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1) * 5e-5
    sigma = float(np.sqrt(np.mean(np.abs(truth) ** 2)) * 10 ** (-snr_db / 20))
    noise = sigma / np.sqrt(2) * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    return response_of(f, truth + noise, sigma), np.asarray(truth), float(natural[4])


def test_the_carrier_is_a_peak_of_the_response_whatever_two_poles_cancel():
    """Two pole pairs at 63.68 Hz whose residues nearly cancel are no strong resonance."""
    model = fit(plate(101)[0])
    double = 2 * np.pi * 63.68 * (-0.006 + 1j)
    cancelling = replace(
        model,
        poles=np.append(model.poles, [double, 1.00001 * double]),
        residues=np.append(model.residues, [1e-2, -1e-2 + 1e-7]),
        resonant=np.append(model.resonant, [True, True]),
        decay_deviation=np.append(model.decay_deviation, [0.0, 0.0]),
    )
    assert max(cancelling.resonances, key=lambda r: r.strength).frequency_hz == pytest.approx(63.68, rel=1e-3)
    assert cancelling.resonance_hz == pytest.approx(model.resonance_hz)


def test_poles_that_coincide_become_one():
    """Also when another pole pair, which is weak but real, is the one whose absence leaves least."""
    response = plate(101, snr_db=60)[0]
    noise = float(np.sqrt(np.mean(response.deviation**2)))
    f = response.frequencies
    weak = 2 * np.pi * 155 * (-0.01 + 1j)
    measured = response.velocity / noise + 3 * -weak.real / (2j * np.pi * f - weak)
    lines = Lines(f, measured)
    single = rational.fit_poles(lines)
    strong = single[np.argsort(np.abs(single.imag / (2 * np.pi) - 263.5))[0]]
    doubled = np.append(single[single != strong], strong + np.array([0.02, -0.02]) * strong.real)
    pruned = rational._pruned(Projection.of(doubled, lines)).poles
    # A pair of the noise, on the edge of being kept, may go too: that depends on the last bits of a library.
    assert len(single) - 1 <= len(pruned) <= len(single)
    apart = np.abs(pruned[:, None] - pruned) + np.diag(np.full(len(pruned), np.inf))
    assert np.all(apart.min(axis=1) > 0.1 * -pruned.real)
    assert np.abs(pruned - weak).min() < -weak.real


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("damping_scale", "snr_db", "most"), [(1, 37, 1.4), (3, 37, 1.7), (1, 27, 1.5)])
def test_the_fit_is_efficient(full, damping_scale, snr_db, most):
    """Within 1.4 of the bound of 12 pole pairs, a constant and a slope: 50 parameters; always stable.

    The bound is of the mean square; a fit that is told the order strays to 1.13 of it. Where modes overlap
    or noise hides them, one plate in ten gets a pair too many or too few, and is further off.
    """
    lines = 1228
    bound = 10 ** (-snr_db / 20) * np.sqrt(50 / (2 * lines))
    errors = []
    for seed in range(100, 200 if full else 108):
        response, truth, strongest = plate(seed, damping_scale, snr_db, lines)
        model = fit(response)
        assert model.stable
        assert model.resonance_hz == pytest.approx(strongest, abs=0.3)
        # It says how far it is from what was measured, which is the noise.
        assert model.error == pytest.approx(10 ** (-snr_db / 20), rel=0.1)
        errors.append(
            np.linalg.norm(model.velocity(response.frequencies) - truth) / np.linalg.norm(truth) / bound
        )
    rms = float(np.sqrt(np.mean(np.square(errors))))
    print(f"error over bound: rms {rms:.2f}, largest {max(errors):.2f} of {len(errors)}")
    assert rms < 1.2 and max(errors) < most


def test_resonances_are_the_modes():
    response, _, strongest = plate(3)
    resonance = max(fit(response).resonances, key=lambda r: r.strength)
    assert resonance.frequency_hz == pytest.approx(strongest, abs=0.05)
    rng = np.random.default_rng(3)
    rng.uniform(-15, 15, 12)
    rng.uniform(-1, 1)
    assert resonance.damping == pytest.approx(rng.uniform(0.005, 0.02, 12)[4], rel=0.02)
    assert resonance.strength == pytest.approx(1.5 * 5e-5, rel=0.03)


def test_noise_alone_is_stable_or_refused():
    response, _, _ = plate(0, snr_db=-40)
    try:
        model = fit(response)
    except DataError as error:
        assert "resonance" in str(error)
    else:
        assert model.stable
        assert model.error > 0.8


LINES = np.linspace(20, 620, 600)


@pytest.mark.parametrize(("f", "velocity", "says"), [
    (LINES, np.zeros(600, complex), "zero, NaN or infinite"),
    (LINES, np.full(600, np.nan + 0j), "zero, NaN or infinite"),
    (LINES[:7], np.ones(7, complex), "7 lines"),
    (LINES[::-1], np.ones(600, complex), "ascending"),
    (LINES - 20, np.ones(600, complex), "above 0 Hz"),
    (LINES, 1 / (2j * np.pi * LINES + 300), "No resonance"),  # a real pole
    (LINES, np.ones(600, complex), "No resonance"),
    (LINES, 2j * np.pi * LINES, "No resonance"),  # a slope
    (LINES, np.exp(-1e-3 * 2j * np.pi * LINES), "No resonance"),  # a delay
])  # fmt: skip
def test_what_no_fit_can_use_is_refused(f, velocity, says):
    raises(DataError, says, fit, response_of(f, velocity))


def measured_beam(lowest: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines (Hz) and accelerance, measured by the pyuff project (ladisk/pyuff, MIT licence)."""
    accelerance = np.array([complex(line) for line in BEAM.read_text().split()])
    f = np.arange(len(accelerance), dtype=np.float64)
    return f[f >= lowest], accelerance[f >= lowest]


def assert_six(model: Model) -> None:
    """Natural frequencies of a free beam go as the squares of these (Blevins, table 8-1)."""
    expected = 51.5 * (np.array([4.730, 7.853, 10.996, 14.137, 17.279, 20.420]) / 4.730) ** 2
    named = np.array([r.frequency_hz for r in model.resonances])
    assert len(named) == 6
    assert np.abs(named / expected - 1).max() < 0.01


@pytest.mark.parametrize("lowest", [5, 10, 20])
@pytest.mark.parametrize("quantity", ["velocity", "accelerance"])
def test_six_resonances_of_a_real_beam_are_six(lowest, quantity):
    """All are far narrower than the lines of 1 Hz, and no simulator of ours made them."""
    f, accelerance = measured_beam(lowest)
    H = accelerance if quantity == "accelerance" else accelerance / (2j * np.pi * f)
    model = fit(response_of(f, H))
    print(f"beam: {len(model.poles)} poles, error {model.error:.2%}")
    assert model.stable and model.error < 0.01
    assert_six(model)
    # pyEMA finds 0.057 % at the first one; lines of 1 Hz only bound it.
    first = model.resonances[0]
    assert first.damping_is_bound and first.damping_interval[1] > 0.00057


@pytest.mark.parametrize("quantity", ["velocity", "accelerance"])
def test_a_real_beam_is_fitted_no_worse_than_by_scikit_rf(quantity):
    f, accelerance = measured_beam(10)
    H = accelerance if quantity == "accelerance" else accelerance / (2j * np.pi * f)
    case = Case(response_of(f, H), H, np.empty(0))
    assert fit(case.response).error <= np.linalg.norm(auto_fit(case) - H) / np.linalg.norm(H)


def test_modes_of_synthetic_beams_are_named_and_nothing_else(full):
    for number in range(200 if full else 8):
        case = beam(number)
        hits, extra = found(fit(case.response), case.natural)
        assert (hits, extra) == (len(case.natural), 0), number


def test_a_plate_of_twelve_modes_names_no_thirteenth(full):
    for number in range(200 if full else 4):
        case = plate_of(number)
        assert found(fit(case.response), case.natural)[1] == 0, number


def test_thirty_modes_are_fitted_to_the_noise(full):
    """Peaks show about two thirds of them, and on plate 2 no missing one is worth it without the others."""
    for number in range(200) if full else (2, 3):
        assert fit(plate_of(number, modes=30).response).error < 0.016, number


def test_damping_lies_in_its_interval_or_is_said_to_be_a_bound(full):
    """The line spacing is 0.49 Hz: a mode of 0.1 % at 100 Hz is narrower, one of 1 % is not."""
    count, inside = (100, 0) if full else (8, 0)
    f = np.linspace(20, 620, 1228)
    for number in range(count):
        rng = generator("damping", number)
        natural, damping = np.array([100.0, 300.0]) + rng.uniform(-5, 5, 2), np.array([0.001, 0.01])
        s, w = 2j * np.pi * f[:, None], 2 * np.pi * natural
        H = (2 * damping * w * s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1)
        H = H + 0.003 * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
        narrow, wide = fit(response_of(f, H, 0.003 * np.sqrt(2))).resonances
        assert narrow.damping_is_bound and not wide.damping_is_bound
        inside += narrow.damping_interval[1] > 0.001
        inside += wide.damping_interval[0] < 0.01 < wide.damping_interval[1]
    print(f"{inside} of {2 * count} inside")
    assert inside >= 0.9 * 2 * count


@pytest.mark.parametrize(("second", "named"), [(0.95, 2), (0.8, 1)])
def test_a_carrier_that_another_measurement_may_not_find_is_ambiguous(second, named):
    f = np.linspace(20, 620, 1228)
    s, w, damping = 2j * np.pi * f[:, None], 2 * np.pi * np.array([150.0, 400.0]), 0.01
    H = (np.array([1.0, second]) * 2 * damping * w * s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1)
    model = fit(response_of(f, H))
    assert [round(r.frequency_hz) for r in model.carriers] == [150, 400][:named]
    assert model.resonance_hz == pytest.approx(150, abs=0.01)
    assert (model.ambiguity == "") is (named == 1)
    if named == 2:
        assert "150.00 and 400.00 Hz" in model.ambiguity


@pytest.mark.timeout(3600)
def test_the_carrier_is_the_plants_on_tables_that_nobody_chose(full):
    if not full:
        pytest.skip("200 calibrations: --full")
    for number in range(200):
        seed = int(generator("carrier", number).integers(2**32))
        with open_rig("simulated", simulation={"seed": seed}) as rig:
            truth = rig.simulation.truth
            f = np.arange(20, 620, 0.05)
            strongest = f[np.argmax(np.abs(truth.velocity_response("A", "button", f)))]
            assert strongest == pytest.approx(truth.resonance_hz, abs=0.1)
            assert calibrate(rig).model.resonance_hz == pytest.approx(truth.resonance_hz, abs=0.3), seed


@pytest.mark.parametrize(("modes", "damping", "lines"), [(1, 0.1, 9), (1, 0.01, 1228), (30, 0.002, 1228)])
def test_a_response_without_noise_is_fitted_exactly(modes, damping, lines):
    rng, f = generator("exact", modes), np.linspace(20, 620, lines)
    s, w = (
        2j * np.pi * f[:, None],
        2 * np.pi * np.linspace(60, 580, modes + 2)[1:-1] * rng.uniform(0.99, 1.01, modes),
    )
    H = (s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1)
    model = fit(response_of(f, H))
    assert model.error < 1e-6 and len(model.resonances) == modes


@pytest.fixture(scope="module")
def fitted() -> tuple[Response, np.ndarray]:
    response, _, _ = plate(7, lines=600)
    return response, response.frequencies


def test_state_space_is_the_model(fitted):
    response, f = fitted
    model = fit(response)
    A, B, C, D = model.state_space()
    assert np.linalg.eigvals(A).real.max() < 0
    _, H = freqresp(StateSpace(A, B, C, D), 2 * np.pi * f)
    assert np.linalg.norm(H - model.velocity(f)) < 1e-4 * np.linalg.norm(H)


@pytest.mark.parametrize(("rate_hz", "within"), [(5e3, 1e-3), (50e3, 1e-3)])
def test_sections_are_the_model(fitted, rate_hz, within):
    response, f = fitted
    model = fit(response)
    sections = model.sos(rate_hz)
    assert np.abs(np.concatenate([np.roots(row[3:]) for row in sections])).max() < 1
    _, H = sosfreqz(sections, f, fs=rate_hz)
    assert np.linalg.norm(H - model.velocity(f)) < within * np.linalg.norm(H)
    raises(ConfigurationError, "four times its band", model.sos, 2000.0)


def test_a_matlab_file_holds_all_of_it(fitted, tmp_path):
    response, f = fitted
    model, path = fit(response), tmp_path / "model.mat"
    savemat(path, model.variables(50e3))
    back = loadmat(path, squeeze_me=True)
    _, H = freqresp(StateSpace(back["A"], back["B"][:, None], back["C"][None, :], back["D"]), 2 * np.pi * f)
    assert np.linalg.norm(H - model.velocity(f)) < 1e-4 * np.linalg.norm(H)
    _, H = sosfreqz(back["sos"], f, fs=float(back["rate_hz"]))
    assert np.linalg.norm(H - model.velocity(f)) < 1e-3 * np.linalg.norm(H)
    assert np.array_equal(back["poles"], model.poles) and tuple(back["band_hz"]) == model.band
    assert back["input"] == "V at the patch"


@pytest.mark.parametrize(("one", "other", "by"), [
    # Patch A at the button, and patch C near a node of three modes (a simulated table: 0.44 % was said).
    ((68.0, 137.4, 203.1, 242.3, 263.6, 389.3, 432.8, 490.3, 521.5, 611.2),
     (68.0, 137.4, 242.3, 263.6, 392.8, 521.5, 582.9), 0.0),
    ((68.0, 137.4, 203.1, 263.6), (68.68, 138.77, 266.24), 0.01),
])  # fmt: skip
def test_a_patch_near_a_node_is_of_the_same_table(one, other, by):
    models: Any = [
        SimpleNamespace(resonances=[SimpleNamespace(frequency_hz=hz) for hz in each]) for each in (one, other)
    ]
    assert apart(*models) == apart(*reversed(models)) == pytest.approx(by, abs=2e-4)
