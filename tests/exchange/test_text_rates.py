"""Sample rates as people write them, and what is none."""

import pytest

from haploop.exchange.columns.text_rates import stated_by, stated_rates


@pytest.mark.parametrize(
    ("row", "decimal", "hz"),
    [
        ("Sample rate|5000|5000|5000", ".", 5000.0),
        ("Sample rate|5000|2500", ".", None),
        ("Abtastrate: 2,5 kHz", ",", 2500.0),
        ("Abtastrate: 5.000 Hz", ",", None),  # five, or five thousand
        ("Sample rate: 5,000 Hz", ".", 5000.0),
        ("Sampling interval: 0,2 ms", ".", 5000.0),
        ("Sample rate: 100|000 Hz", ".", None),
        ("Sampling rate (samples/min)|120", ".", 2.0),
        ("Sample rate: 1 MS/s", ".", 1e6),
        ("Sampling interval|10ms", ".", 100.0),
        ("dt = 0.0002", ".", None),
        ("Sample rate: 5 furlongs", ".", None),
    ],
)
def test_a_rate_is_read_with_its_unit(row, decimal, hz):
    (found,) = stated_rates([row.split("|")], decimal, None)
    assert found.hz == hz


@pytest.mark.parametrize(
    ("name", "value", "hz"),
    [
        *((name, 5000.0, 5000.0) for name in (
            "fs", "Fs", "sr", "rate", "srate", "sample_rate", "sampleRate", "SamplingFrequency", "samplefreq",
            "sample_rate_hz", "samples_per_second", "SamplesPerSec", "fs_Hz")),
        *((name, 5.0, 5000.0) for name in ("fs_kHz", "sampleRate_kHz", "sampling rate kHz")),
        *((name, 2e-4, 5000.0) for name in ("wf_increment", "Tinterval", "SampleTime", "dt_s", "dtSec")),
        *((name, 0.2, 5000.0) for name in ("dt_ms", "time_step_ms", "samplingInterval_ms", "xIncrement_ms")),
        *((name, 2e-4, None) for name in ("dt", "Ts", "delta_t", "x_inc", "timeStep", "sampling_interval")),
        ("fs", 0.2, None),
    ],
)  # fmt: skip
def test_an_entry_beside_arrays_states_a_rate_as_a_text_does(name, value, hz):
    found = stated_by(name, value)
    assert found is not None and found.hz == hz


@pytest.mark.parametrize(
    "name", ["learning_rate", "baud_rate", "max_sample_rate", "heartRate", "fs_offset", "dtype", "force", "T"]
)
def test_an_entry_that_states_no_rate(name):
    assert stated_by(name, 5000.0) is None


@pytest.mark.parametrize(
    "row",
    ["Sample rate divider: 4", "Oversampling rate: 64", "Frame rate: 30 fps", "Rate|5000",
     "Loading rate 5 N/s", "Data rate 9600 bps", "Cut-off: 500 Hz", "Sampling time: 10 s"],
)  # fmt: skip
def test_what_is_no_rate_of_samples(row):
    assert not stated_rates([row.split("|")], ".", None)
