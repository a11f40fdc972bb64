from __future__ import annotations

import numpy as np
import pytest

from haploop.calibration import feeling_of
from haploop.reports.figures.encoding import png
from haploop.reports.figures.paper import Profile, activation_forces, profiles
from haploop.reports.figures.plotting import active, continuous_phase, spectrum
from haploop.reports.html.rendering import CaptionedFigure, render
from haploop.reports.show import feeling_values

RATE = 5000.0


def profile(button: str = "latch", **changes: object) -> Profile:
    time = (np.arange(2500) - 750) / RATE
    ring = np.where(time > 0, np.exp(-60 * np.clip(time, 0, None)) * np.sin(2 * np.pi * 200 * time), 0.0)
    values: dict[str, object] = {
        "button": button,
        "time": time,
        "acceleration": 8 * ring,
        "force": np.clip(time + 0.1, 0, 0.2) * 30,
        "activation": (time > 0).astype(float),
        "rate_hz": RATE,
        "bandwidth_hz": 500.0,
        "spread": np.full(2500, 0.1),
    }
    return Profile(**{**values, **changes})  # type: ignore[arg-type]


def test_spectral_density_integrates_to_the_mean_square() -> None:
    signal = np.random.default_rng(1).standard_normal(5000)
    frequencies, density = spectrum(signal, RATE)
    assert np.sum(density) * frequencies[1] == pytest.approx(np.mean(signal**2), rel=1e-9)


def test_spectral_density_is_largest_where_the_signal_is() -> None:
    time = np.arange(1000) / RATE
    frequencies, density = spectrum(np.sin(2 * np.pi * 263.5 * time), RATE)
    assert frequencies[np.argmax(density)] == pytest.approx(263.5, abs=2)


def test_phase_follows_the_model_through_noise() -> None:
    f = np.linspace(50, 600, 2000)
    smooth = np.exp(-2j * np.pi * f * 0.01)
    noisy = smooth + 0.9 * np.exp(2j * np.pi * np.random.default_rng(2).random(2000))
    followed = continuous_phase(noisy, smooth, 1000)
    assert np.abs(followed - continuous_phase(smooth, smooth, 1000)).max() <= 180
    assert abs(continuous_phase(smooth, smooth, 1000)[1000]) <= 180


def test_silence_has_no_active_part_to_cut_to() -> None:
    assert active(np.zeros(500), RATE) == (0.0, 0.1)


def test_a_press_is_drawn_normalised_with_its_spectrum() -> None:
    figure = profiles([profile("latch"), profile("push")])
    left = figure.axes[0]
    drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in left.lines}
    assert np.abs(drawn["Acceleration"]).max() == pytest.approx(1.0)
    assert [axes.get_title(loc="left").split()[-1] for axes in figure.axes[:1]] == ["Latch"]
    assert len(figure.axes) == 6  # two panels a button, and the force's own axis


@pytest.mark.parametrize("participants", [1, 12])
def test_forces_show_every_press_and_the_mean(participants: int) -> None:
    rng = np.random.default_rng(3)
    names = [f"P{k:02d}" for k in range(1, participants + 1)]
    forces = {
        b: {p: rng.normal(m, 0.2, 10) for p in names} for b, m in (("latch", 7), ("toggle", 2), ("push", 4))
    }
    figure = activation_forces(forces, {"latch": 7.0})
    together = figure.axes[1]
    assert together.get_title(loc="left").endswith("All together")
    points = np.concatenate([np.asarray(line.get_ydata()) for line in together.lines if line.get_alpha()])
    assert sorted(points) == pytest.approx(
        sorted(np.concatenate([v for b in forces.values() for v in b.values()]))
    )


def test_one_press_alone_and_a_silent_one_can_be_drawn() -> None:
    assert png(activation_forces({"latch": {"P01": np.array([7.0])}}))
    assert png(profiles([profile(acceleration=np.zeros(2500), force=np.zeros(2500))]))


def test_the_same_figure_is_the_same_bytes() -> None:
    first, second = (png(profiles([profile()])) for _ in range(2))
    assert first == second
    assert b"Software" not in first and b"matplotlib" not in first


def summary(**changes: object) -> dict[str, object]:
    silence = np.zeros(2500)
    button = {
        "presses": 10, "presses_detected": 9, "activation_force_n": None, "activation_force_true_n": 7.5,
        "drive_peak_v": 48.0, "scale": 0.8, "in_band": 0.9, "band_hz": [30.0, 600.0],
        "wideband_nrmse": 0.31, "wideband_interval": [0.3, 0.32], "wideband_floor": 0.05,
        "judged_hz": 2500.0, "nrmse": 0.3, "outside": 0.08, "correlation": 0.95, "envelope_correlation": 0.97,
        "third_octave_error_db": 2.0, "floor": 0.05, "tolerance": 0.2,
        "passed": False, "verdict": "fail", "notes": [], "left_out": [],
        "reasons": ["The surface differs by 31 % <rms>."],
        "feeling": feeling_values(feeling_of(silence, silence, 5000.0, silence)),
        "sources": [{"file": "P01-latch.h5", "sha256": "ab12"}],
    }  # fmt: skip
    values: dict[str, object] = {
        "simulated": True, "mode": "twin", "rig": "lab", "rig_file": "lab.toml", "seed": 3,
        "simulation": {"seed": 3}, "participants": 1, "buttons": {"latch": button}, "patch": "A",
        "point": "button", "resonance_hz": 263.5, "resonance_true_hz": 263.6, "model_error": 0.01,
        "coherence_min_in_band": 0.9, "band_hz": [30.0, 600.0], "simulated_s": 90.0, "wall_s": 20.0,
        "notes": [],
        "folder": "demo", "report": "demo/report.html", "software": {"haploop": "0.1.0"},
        "date": "2026-01-02T03:04:05+00:00", "passed": False,
    }  # fmt: skip
    return {**values, **changes}


def test_a_failed_button_is_reported_as_failed_with_its_reason() -> None:
    page = render(summary(), [])
    assert 'class="failed"' in page and ">Fail<" in page and ">Pass<" not in page
    assert "The surface differs by 31 % &lt;rms&gt;." in page
    assert "not measured" in page
    assert "Everything here is simulated" in page


def test_a_real_rig_s_report_does_not_call_itself_simulated() -> None:
    page = render(summary(simulated=False), [])
    assert "simulated" not in page.replace(".simulated", "")
    assert "Truth" not in page


def test_a_report_is_the_same_when_it_is_made_again() -> None:
    def page() -> str:
        return render(summary(), [CaptionedFigure(profiles([profile()]), "A press", "A caption.", True)])

    assert page() == page()


def test_presses_that_agree_lie_within_the_panel_of_all_buttons() -> None:
    values = np.array([7.48, 7.5, 7.55])
    for force in (values, 1e-3 * values):
        together = activation_forces({"latch": {"P01": force}}).axes[1]
        low, high = together.get_ylim()
        assert low == 0 and force.max() < 0.95 * high
