from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import StateSpace, freqresp, sosfreqz

from haploop.calibration import Response, fit
from haploop.calibration.model import rational
from haploop.instruments import ConfigurationError, DataError

BEAM = Path(__file__).parents[2] / "data" / "beam_accelerance_point1.txt"


def response_of(f: np.ndarray, velocity: np.ndarray, sigma: float = 0.0) -> Response:
    ones = np.ones(len(f))
    return Response(
        patch="A",
        point="button",
        frequencies=f,
        velocity=velocity,
        deviation=sigma * ones if sigma else np.zeros(0),
        coherence=ones,
        path=ones.astype(complex),
        noise=1e-7 * ones,
        distortion=np.zeros((0, 0)),
        repeats=3,
        level=48.0,
        levels=np.zeros(0),
        level_gain=np.zeros(0, complex),
        velocity_range=0.02,
        excitation="made for a test; 0.0 s of measuring",
        source="measured",
        rig="made for a test",
        rig_file="",
        simulated=True,
        created="2026-01-01T00:00:00+00:00",
    )


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


def test_the_carrier_is_a_peak_of_the_response_whatever_two_poles_cancel() -> None:
    """Two pole pairs at 63.68 Hz whose residues nearly cancel are no strong resonance."""
    model = fit(plate(101)[0])
    double = 2 * np.pi * 63.68 * (-0.006 + 1j)
    cancelling = replace(
        model,
        poles=np.append(model.poles, [double, 1.00001 * double]),
        residues=np.append(model.residues, [1e-2, -1e-2 + 1e-7]),
    )
    assert max(cancelling.resonances, key=lambda r: r.strength).frequency_hz == pytest.approx(63.68, rel=1e-3)
    assert cancelling.resonance_hz == pytest.approx(model.resonance_hz)


def test_poles_that_coincide_become_one() -> None:
    """Also when another pole pair, which is weak but real, is the one whose absence leaves least."""
    response = plate(101, snr_db=60)[0]
    noise = float(np.sqrt(np.mean(response.deviation**2)))
    f = response.frequencies
    weak = 2 * np.pi * 155 * (-0.01 + 1j)
    measured = response.velocity / noise + 3 * -weak.real / (2j * np.pi * f - weak)
    lines = rational.Lines(f, measured)
    single = rational.fit_poles(lines)
    strong = single[np.argsort(np.abs(single.imag / (2 * np.pi) - 263.5))[0]]
    doubled = np.append(single[single != strong], strong + np.array([0.02, -0.02]) * strong.real)
    pruned = rational._pruned(rational._Fit.of(doubled, lines), lines)
    assert len(pruned) == len(single)
    apart = np.abs(pruned[:, None] - pruned) + np.diag(np.full(len(pruned), np.inf))
    assert np.all(apart.min(axis=1) > 0.1 * -pruned.real)
    assert np.abs(pruned - weak).min() < -weak.real


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("damping_scale", "snr_db", "most"), [(1, 37, 1.3), (3, 37, 1.7), (1, 27, 1.5)])
def test_the_fit_is_as_good_as_its_number_of_parameters_allows(
    full: bool, damping_scale: float, snr_db: float, most: float
) -> None:
    """Within 1.3 of the bound of 12 pole pairs, a constant and a slope: 50 parameters; always stable.

    The bound is of the mean square; a fit that is told the order strays to 1.13 of it. Where modes overlap
    or noise hides them, one plate in ten gets a pair too many or too few, and is further off.
    """
    lines = 1228
    bound = 10 ** (-snr_db / 20) * np.sqrt(50 / (2 * lines))
    errors = []
    for seed in range(100, 120) if full else (101, 102):
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


def test_resonances_are_the_modes() -> None:
    response, _, strongest = plate(3)
    resonance = max(fit(response).resonances, key=lambda r: r.strength)
    assert resonance.frequency_hz == pytest.approx(strongest, abs=0.05)
    rng = np.random.default_rng(3)
    rng.uniform(-15, 15, 12)
    rng.uniform(-1, 1)
    assert resonance.damping == pytest.approx(rng.uniform(0.005, 0.02, 12)[4], rel=0.02)
    assert resonance.strength == pytest.approx(1.5 * 5e-5, rel=0.03)


def test_noise_alone_is_stable_or_refused() -> None:
    response, _, _ = plate(0, snr_db=-40)
    try:
        model = fit(response)
    except DataError as error:
        assert "resonance" in str(error)
    else:
        assert model.stable
        assert model.error > 0.8


@pytest.mark.parametrize("velocity", [np.zeros(50, complex), np.full(50, np.nan + 0j)])
def test_what_is_no_response_is_refused(velocity: np.ndarray) -> None:
    with pytest.raises(DataError, match="zero, NaN or infinite"):
        fit(response_of(np.linspace(20, 600, 50), velocity))


def test_a_real_beam_is_fitted_stably_and_the_error_is_said() -> None:
    """One that no simulator of ours made: six resonances, all far narrower than its lines of 1 Hz.

    Measured by the pyuff project (ladisk/pyuff, MIT licence). Natural frequencies of a free beam go
    as the squares of those below (Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1).
    """
    accelerance = np.array([complex(line) for line in BEAM.read_text().split()])
    f = np.arange(len(accelerance), dtype=np.float64)
    kept = (f >= 10) & (f <= 999)
    response = response_of(f[kept], accelerance[kept] / (2j * np.pi * f[kept]))
    model = fit(response)
    print(f"beam: {len(model.poles)} pole pairs, error {model.error:.2%}")
    assert model.stable
    assert model.error < 0.05
    left = (model.velocity(f[kept]) - response.velocity) * 2j * np.pi * f[kept]
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(accelerance[kept])
    resonances = np.array([r.frequency_hz for r in model.resonances])
    for beta in (4.730, 7.853, 10.996, 14.137, 17.279, 20.420):
        expected = 51.5 * (beta / 4.730) ** 2
        assert np.abs(resonances / expected - 1).min() < 0.01


@pytest.fixture(scope="module")
def fitted() -> tuple[Response, np.ndarray]:
    response, _, _ = plate(7, lines=600)
    return response, response.frequencies


def test_state_space_is_the_model(fitted: tuple[Response, np.ndarray]) -> None:
    response, f = fitted
    model = fit(response)
    A, B, C, D = model.state_space()
    assert np.linalg.eigvals(A).real.max() < 0
    _, H = freqresp(StateSpace(A, B, C, D), 2 * np.pi * f)
    assert np.linalg.norm(H - model.velocity(f)) < 1e-4 * np.linalg.norm(H)


@pytest.mark.parametrize(("rate_hz", "within"), [(5e3, 1e-3), (50e3, 1e-3)])
def test_sections_are_the_model(fitted: tuple[Response, np.ndarray], rate_hz: float, within: float) -> None:
    response, f = fitted
    model = fit(response)
    sections = model.sos(rate_hz)
    assert np.abs(np.concatenate([np.roots(row[3:]) for row in sections])).max() < 1
    _, H = sosfreqz(sections, f, fs=rate_hz)
    assert np.linalg.norm(H - model.velocity(f)) < within * np.linalg.norm(H)
    with pytest.raises(ConfigurationError, match="four times its band"):
        model.sos(2000.0)


def test_a_matlab_file_holds_all_of_it(fitted: tuple[Response, np.ndarray], tmp_path: Path) -> None:
    response, f = fitted
    model, path = fit(response), tmp_path / "model.mat"
    model.save_mat(path, 50e3)
    back = loadmat(path, squeeze_me=True)
    _, H = freqresp(StateSpace(back["A"], back["B"][:, None], back["C"][None, :], back["D"]), 2 * np.pi * f)
    assert np.linalg.norm(H - model.velocity(f)) < 1e-4 * np.linalg.norm(H)
    _, H = sosfreqz(back["sos"], f, fs=float(back["rate_hz"]))
    assert np.linalg.norm(H - model.velocity(f)) < 1e-3 * np.linalg.norm(H)
    assert np.array_equal(back["poles"], model.poles) and tuple(back["band_hz"]) == model.band
    assert back["input"] == "V at the patch"
    with pytest.raises(DataError, match="not overwritten"):
        model.save_mat(path)
    assert [p.name for p in tmp_path.iterdir()] == ["model.mat"]
