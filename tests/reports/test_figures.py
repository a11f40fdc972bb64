import numpy as np
import pytest

import haploop
from haploop.base.errors import DataError
from haploop.reports.contents import Cell, Contents, Grid, Verdict, fact, plain, verdict_cell
from haploop.reports.figures import Profile, activation_forces, profiles
from haploop.reports.figures.encoding import png
from haploop.reports.figures.plotting import active, continuous_phase, smoothed, spectrum
from haploop.reports.html import Page
from tests.raising import raises

RATE = 5000.0


def profile(button: str = "latch", **changes: object) -> Profile:
    time = (np.arange(2500) - 750) / RATE
    ring = np.where(time > 0, np.exp(-60 * np.clip(time, 0, None)) * np.sin(2 * np.pi * 200 * time), 0.0)
    values: dict[str, object] = {
        "button": button, "time": time, "acceleration": 8 * ring, "force": np.clip(time + 0.1, 0, 0.2) * 30,
        "activation": (time > 0).astype(float), "rate_hz": RATE, "bandwidth_hz": 500.0,
        "spread": np.full(2500, 0.1),
    }  # fmt: skip
    return Profile(**{**values, **changes})


def test_spectral_density_integrates_to_the_mean_square():
    signal = np.random.default_rng(1).standard_normal(5000)
    frequencies, density = spectrum(signal, RATE)
    assert np.sum(density) * frequencies[1] == pytest.approx(np.mean(signal**2), rel=1e-9)


def test_means_of_a_density_keep_its_power_and_thin_its_noise():
    noise = np.random.default_rng(1).normal(size=50_000)
    f, density = spectrum(noise, 5000)
    middle, means = smoothed(f, density, 2500)
    assert len(middle) == 100 and np.all(np.diff(middle) > 0)
    assert means.mean() == pytest.approx(density.mean(), rel=0.01)
    assert means.max() / means.min() < 2 < density.max() / density[1:].min()
    assert dir(haploop.plot) == sorted(haploop.plot.__all__)


def test_spectral_density_is_largest_where_the_signal_is():
    time = np.arange(1000) / RATE
    frequencies, density = spectrum(np.sin(2 * np.pi * 263.5 * time), RATE)
    assert frequencies[np.argmax(density)] == pytest.approx(263.5, abs=2)


def test_phase_follows_the_model_through_noise():
    f = np.linspace(50, 600, 2000)
    smooth = np.exp(-2j * np.pi * f * 0.01)
    noisy = smooth + 0.9 * np.exp(2j * np.pi * np.random.default_rng(2).random(2000))
    followed = continuous_phase(noisy, smooth, 1000)
    assert np.abs(followed - continuous_phase(smooth, smooth, 1000)).max() <= 180
    assert abs(continuous_phase(smooth, smooth, 1000)[1000]) <= 180


def test_silence_has_no_active_part_to_cut_to():
    assert active(np.zeros(500), RATE) == (0.0, 0.1)


def test_a_press_is_drawn_normalised_with_its_spectrum():
    figure = profiles([profile("latch"), profile("push")])
    left = figure.axes[0]
    drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in left.lines}
    assert np.abs(drawn["Acceleration"]).max() == pytest.approx(1.0)
    assert [axes.get_title(loc="left").split()[-1] for axes in figure.axes[:1]] == ["Latch"]
    assert len(figure.axes) == 6  # two panels a button, and the force's own axis


@pytest.mark.parametrize("participants", [1, 12])
def test_forces_show_every_press_and_the_mean(participants):
    rng = np.random.default_rng(3)
    names = [f"P{k:02d}" for k in range(1, participants + 1)]
    forces = {
        b: {p: rng.normal(m, 0.2, 10) for p in names} for b, m in (("latch", 7), ("toggle", 2), ("push", 4))
    }
    figure = activation_forces(forces, {"latch": 7.0})
    together = figure.axes[1]
    assert together.get_title(loc="left").endswith("All together")
    points = np.concatenate([np.asarray(line.get_ydata()) for line in together.lines if line.get_alpha()])
    all_of_them = np.concatenate([v for b in forces.values() for v in b.values()])
    assert sorted(points) == pytest.approx(sorted(all_of_them))


def test_one_press_alone_and_a_silent_one_can_be_drawn():
    assert png(activation_forces({"latch": {"P01": np.array([7.0])}}))
    assert png(profiles([profile(acceleration=np.zeros(2500), force=np.zeros(2500))]))


def section(verdict: str = "fail", simulated: bool = True) -> Contents:
    said = Verdict("Check of the <latch>", verdict, verdict == "pass", "error 31 %", "It differs <rms>.")
    return Contents(
        "Check of the <latch>",
        [fact("Error", "31.0 %", error=0.31), fact("Verdict", verdict_cell(verdict)), fact(scale=0.8)],
        [Grid("Levels & bands", ("Band", "dB"), [("a", "1.0"), ("b", Cell("-", "aside"))], below="Of two.")],
        ["A note & no markup."],
        simulated=simulated,
        verdicts=[said],
    )


@pytest.mark.parametrize(("verdict", "tone"), [("fail", "bad"), ("pass", "good"), ("not shown", "doubtful")])
def test_a_verdict_is_reported_as_what_it_is_with_its_reason(verdict, tone):
    page = Page("Report", "Rig: lab.", [section(verdict)]).html()
    assert f'<td class="{tone}">{verdict}</td>' in page
    told = "FAIL" if verdict == "fail" else verdict
    assert f'<dd class="{tone}">{told}</dd>' in page
    assert "It differs &lt;rms&gt;." in page and "A note &amp; no markup." in page
    assert '<td class="aside">-</td>' in page and "Of two." in page and "0.8" not in page
    assert "Everything here is simulated" in page


def test_a_real_rig_s_report_does_not_call_itself_simulated():
    page = Page("Report", "Rig: lab.", [section(simulated=False)]).html()
    assert "simulated" not in page.replace(".simulated", "").lower()
    both = Page("Report", "Rig: lab.", [section(simulated=False), section()]).html()
    assert "Simulated in part." in both


def test_values_are_json_and_lines_are_text():
    found = Contents("A", [fact("Error", ["1", "", "2"], error=np.float64("nan"), of=np.arange(2))], kind="k")
    assert found.values == {"kind": "k", "error": None, "of": [0, 1]}
    assert found.rows == [("Error", "1"), ("", "2")]
    raises(DataError, "no plot", found.draw)
    raises(TypeError, "object has no form", plain, object())


def test_presses_that_agree_lie_within_the_panel_of_all_buttons():
    values = np.array([7.48, 7.5, 7.55])
    for force in (values, 1e-3 * values):
        together = activation_forces({"latch": {"P01": force}}).axes[1]
        low, high = together.get_ylim()
        assert low == 0 and force.max() < 0.95 * high
