"""Whatever is played, and whenever: no coil is warmed beyond its watts, at the plant, by another rule."""

from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from haploop.base.arrays import FloatArray
from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import Limits, load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits
from haploop.instruments.daq import Block
from haploop.instruments.limits import Coil
from haploop.instruments.safety.abort_monitor import AbortMonitor
from haploop.mocks.plant import AMPLIFIER_GAIN_ERROR, AmplifierOutput
from tests.instruments.safety.lab import lab
from tests.rig_files import changed

RATE = 50_000
FILE = load_rig_file("voice-coil")


def warmest(record: list[AmplifierOutput], ohms: float, seconds: float) -> float:
    """Largest smoothed V^2 / R, stepped through the record; without the inductance it is never less."""
    state, now, most, volts = 0.0, 0.0, 0.0, 0.0
    for output in record:
        period = output.period if np.isfinite(output.period) else 0.0
        for k, value in enumerate(output.volts[::20]):  # a coarse grid: a hundredth of the time constant
            at = output.start + 20 * k * period
            state += (volts**2 / ohms - state) * -np.expm1(-max(at - now, 0.0) / seconds)
            most, now, volts = max(most, state), max(at, now), float(value)
    return most


def shaped(peak: float, seconds: float, hz: float) -> FloatArray:
    count = round(seconds * RATE)
    drive = peak * np.sin(2 * np.pi * hz * np.arange(count) / RATE) * np.sin(np.pi * np.arange(count) / count)
    return np.asarray(drive - drive.mean() * np.hanning(count) / np.hanning(count).mean())


@settings(max_examples=5, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(
    drive=st.builds(shaped, st.floats(0.3, 0.95), st.floats(0.1, 1.0), st.sampled_from([60.0, 250.0, 600.0])),
    often=st.integers(3, 7),
    rest=st.floats(0, 1),
    share=st.floats(1.05, 2.5),
    thermal_time=st.floats(0.5, 4.0),
)
def test_no_coil_is_warmed_beyond_its_watts(drive, often, rest, share, thermal_time):
    """The same play again and again, each by a command of its own; one alone warms it by 1 / `share`."""
    watts = share * float(Coil(8.0, 0.5e-3, thermal_time).heat(drive, RATE).max())
    file = changed(FILE, actuator={"watts": watts, "thermal_time": thermal_time}, simulate=None)
    with TemporaryDirectory() as folder, lab(Path(folder), file) as here:
        record = here.truth.record()
        for _ in range(often):
            with open_rig(file) as rig:
                try:
                    rig.excite(drive, ["A"], ["drive"])
                except LimitError as error:
                    assert "heats the coil" in str(error)
            here.clock.sleep(rest)
        found = warmest(record, 8.0, thermal_time)
        assert found <= watts * (1 + AMPLIFIER_GAIN_ERROR) ** 2 * 1.1  # the inductance is left out of `found`


def test_volts_that_are_not_what_was_asked_for_stop_a_play_by_the_coils_heat():
    """An amplifier whose output drifts warms a coil within the limits of its volts."""
    limits = Limits(min=-4, max=4, coil=Coil(8.0, 0.5e-3, 1.0), power=0.1, current_peak=0.3)
    sensors: Any = SimpleNamespace(
        drive=SimpleNamespace(channels=("monitor",), to_si=lambda volts: 2 * volts), force=None
    )

    def tested(volts: float, blocks: int, warm: float = 0.0) -> None:
        watch = AbortMonitor(AbortLimits(), sensors, None, limits, rate_hz=RATE, warm=warm)
        for number in range(blocks):
            watch.check(Block(number * 5000, np.full((1, 5000), volts / 2), np.zeros(1, bool)), ("monitor",))

    tested(0.9, 50)  # 0.101 W for ever
    tested(1.8, 3)
    for volts, blocks, warm, says in (
        (1.8, 10, 0.0, r"heated to 0\.1\d+ W, and it takes 0\.1 W.*The play was stopped"),
        (1.8, 3, 0.1, "heated to"),
        (3.0, 1, 0.0, r"The coil drew 0\.375 A, and the limit is 0\.3 A"),
    ):
        with pytest.raises(InstrumentError, match=says):
            tested(volts, blocks, warm)
