from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.fft import irfft, rfft, rfftfreq
from scipy.signal import resample_poly

from haploop.base.errors import ConfigurationError
from haploop.calibration import Check, Drive, check_feeling
from haploop.calibration.drive import check
from haploop.calibration.drive.verdict import Signs, judged
from haploop.calibration.perception import lab_threshold, levels_of
from haploop.instruments import Rig, RigFile, open_rig
from haploop.instruments.config import People
from tests.calibration.conftest import Calibrated, make_press


@pytest.fixture(scope="module")
def result(calibrated: Calibrated, drive: Drive) -> Check:
    return check(calibrated.rig, drive, plays=3)


@pytest.mark.long
def test_the_level_is_that_of_the_surface_itself(calibrated, drive, result):
    """The plant's own motion, without laser and without anything that the check computes."""
    rig = calibrated.rig
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    rig.excite_each(drive.by_patch, (rig.vibrometer.channel,), 0.1)
    rate_hz = 20000.0
    now = rig.clock.now()
    velocity = rig.simulation.truth.velocity("button", np.arange(now - 1.5, now, 1 / rate_hz))
    omega = 2j * np.pi * rfftfreq(len(velocity), 1 / rate_hz)
    surface = irfft(rfft(velocity * np.hanning(len(velocity)) ** 0.01) * omega, len(velocity))
    feeling = check_feeling(result)
    true = levels_of(surface, rate_hz)
    assert feeling.measured.pressing == pytest.approx(true.pressing, abs=0.3)
    assert feeling.measured.resting == pytest.approx(true.resting, abs=0.3)


@pytest.mark.long
def test_the_press_is_compared_at_its_own_size_on_the_drives_clock(drive, result):
    press = make_press()
    feeling = check_feeling(result, press)
    own = levels_of(press.acceleration, press.rate_hz)
    assert feeling.recorded.pressing == pytest.approx(own.pressing, abs=0.05)
    assert feeling.recorded_level is not None
    loudest = [np.argmax(level) for level in (feeling.recorded_level, feeling.measured_level)]
    assert np.diff(loudest)[0] / feeling.rate_hz == pytest.approx(0, abs=0.015)
    assert feeling.loudness_db == pytest.approx(feeling.measured.pressing - own.pressing, abs=0.05)
    # The drive's scale says the same, up to what lies outside its band and to the carrier.
    assert feeling.loudness_db == pytest.approx(20 * np.log10(drive.scale), abs=12)
    faster = replace(press, rate_hz=2.5 * press.rate_hz, acceleration=resample_poly(press.acceleration, 5, 2))
    again = check_feeling(result, faster)
    assert again.recorded.pressing == pytest.approx(own.pressing, abs=0.05)


def test_without_a_press_nothing_is_said_of_one(result):
    feeling = check_feeling(result)
    assert feeling.recorded is None and not feeling.recorded_spans and np.isnan(feeling.loudness_db)
    assert not any("recorded" in note for note in feeling.notes)
    assert feeling.noise is not None and feeling.noise_total < feeling.measured.pressing


def test_the_sentence_names_the_force_of_the_press(result):
    press = make_press()
    feeling = check_feeling(result, replace(press, force=np.full(len(press.acceleration), 2.04)))
    assert "a person who presses with 2.0 N feels it" in feeling.sentence
    assert "who presses feels it" in check_feeling(result, replace(press, force=None)).sentence


def test_a_button_that_nobody_can_feel_is_not_verified(result):
    signs = Signs((1.0, 0.0), (0, 0.0), "", None, 50.0)
    fine = judged(replace(result, verdict="pass", reasons=(), notes=()), signs)
    assert fine.verdict != "fail"
    faint = replace(result, target=result.target / 300, accelerations=result.accelerations / 300)
    found = judged(replace(faint, verdict="pass", reasons=(), notes=()), signs)
    assert found.verdict == "fail" and "What nobody can feel is no button." in found.reasons[0]


def with_people(rig: Rig, **more: Any) -> RigFile:
    """The rig's file with a lab's threshold, 9 dB below the table's."""
    people = People(number=12, threshold=-9.0, uncertainty=2.5, spread=4.0, button="push", force=3.8, **more)
    return rig.file.model_copy(update={"people": people})


@pytest.mark.long
def test_a_labs_own_threshold(calibrated, drive, result, tmp_path):
    assert check_feeling(result).felt == "not known"
    with open_rig(with_people(calibrated.rig), simulate="twin") as rig:
        known = check(rig, drive, plays=3)
    known.save(tmp_path / "check.h5")
    feeling, before = check_feeling(Check.load(tmp_path / "check.h5")), check_feeling(result)
    assert feeling.measured.pressing == pytest.approx(before.measured.pressing + 9, abs=0.3)
    assert feeling.felt == "yes" and feeling.sentence.startswith("A person who presses feels it (")
    assert "12 people of this lab, measured with its push button at 3.8 N" in feeling.notes[0]
    # A finger at rest is not what was measured.
    assert feeling.acts[1].level == pytest.approx(before.acts[1].level, abs=0.3)
    np.testing.assert_allclose(feeling.pressing_db, before.pressing_db - 9)


def test_simulated_people_say_nothing_of_a_real_rig(calibrated):
    rig: Any = SimpleNamespace(name="lab", file=with_people(calibrated.rig, simulated=True), simulated=True)
    assert lab_threshold(rig) is not None
    rig.simulated = False
    with pytest.raises(ConfigurationError, match="simulated participants, and the rig is real"):
        lab_threshold(rig)
