"""The carrier is a resonance of the table, in the band of drives, whatever turns beside the table."""

import json
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration import Calibration, calibrate
from haploop.reports.contents import calibration_contents

pytestmark = [pytest.mark.requires("simulation"), pytest.mark.many_plays]


def said(calibration: Calibration, label: str) -> str:
    (lines,) = [one.lines for one in calibration_contents(calibration).facts if one.label == label]
    return " ".join(map(str, lines))


@pytest.mark.parametrize(("machine", "background"), [
    ({"volts": 0.05}, "steady tones at 50.0, 100.0, 150.0, 200.0 Hz, which were taken out"),
    pytest.param({"volts": 0.2, "wander": 1e-3}, "that are not steady and stay in", marks=pytest.mark.long),
    pytest.param(
        {"volts": 0.5, "after": 15.0},
        "look for mains hum (ground the laser's cable), a fan or a motor",
        marks=pytest.mark.long,
    ),
    # In one play alone, and not of the full level: only what the levels say of each other shows it.
    pytest.param({"volts": 0.4, "after": 46.0, "frequency": 182.2}, "", marks=pytest.mark.long),
], ids=["steady", "wandering", "starts", "starts in the last play"])  # fmt: skip
def test_a_machine_is_no_resonance(open, machine, background):
    fault = {"kind": "rotating-machine", "channel": "laser", "frequency": 50.0, **machine}
    rig = open(seed=1, faults=[fault])
    calibration = calibrate(rig)
    assert calibration.carrier_hz == pytest.approx(rig.simulation.truth.resonance_hz, abs=0.1)
    surface: Any = rig.simulation.truth.surface
    modes = surface.modes(rig.clock.now()).natural_hz
    found = np.array([one.frequency_hz for one in calibration.model.resonances])
    assert np.abs(found[:, None] - modes).min(axis=1).max() < 3
    assert background in said(calibration, "Background")


@pytest.fixture(scope="module")
def coil(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    import haploop

    with haploop.open_rig("voice-coil", simulate="twin", simulation={"seed": 1}) as rig:
        return calibrate(rig)


@pytest.mark.long
def test_a_carrier_lies_in_the_band_of_drives_and_says_what_it_costs(coil):
    """A coil moves the table most at 64.58 Hz, below the band: of a press on it a drive holds little."""
    assert coil.carrier_hz == pytest.approx(127.45, abs=0.05)
    assert said(coil, "Resonance") == "127.45 Hz (the strongest of 11, in the band of drives)"
    told = said(coil, "Carrier")
    assert "not 64.58 Hz, which lies outside the band of drives (75 to 600 Hz)" in told
    f = np.array([127.45, 64.58])
    quieter = -np.diff(20 * np.log10(np.abs(coil.model.velocity(f)[::-1])))[0]
    assert f"moves the table {quieter:.1f} dB less" in told


@pytest.mark.long
def test_another_carrier_can_be_chosen_and_says_what_it_costs(coil):
    chosen = coil.carried_by(263.34)
    assert chosen.carrier_hz == 263.34 and chosen.digest != coil.digest
    assert "263.34 Hz, as asked; the strongest resonance is 64.58 Hz: at the same volts" in said(
        chosen, "Carrier"
    )
    for hz in (65.0, 700.0, np.nan):
        with pytest.raises(ConfigurationError, match="choose one between 75 and 600 Hz"):
            coil.carried_by(hz)


@pytest.mark.long
def test_the_command_takes_a_carrier_and_the_drive_plays_it(run, tmp_path):
    out = tmp_path / "c.h5"
    made = run("calibrate", "--carrier", 196, "--no-waveforms", "-o", out, "--json")
    assert made.exit_code == 0
    values = json.loads(made.stdout)
    assert values["carrier_chosen_hz"] == 196 and values["carrier_costs_db"][0] > 3
    assert Calibration.load(out).carrier_hz == 196.0
    assert run("calibrate", "--carrier", 65, "-o", tmp_path / "d.h5").exit_code == 2
