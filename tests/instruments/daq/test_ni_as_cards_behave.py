"""The driver on cards as they behave: filters, few rates, supplies, old outputs, counters."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.ni_sessions import _Deadline

BOTH = pytest.mark.parametrize("simulate", ["twin", "wire"])


def _rig(tmp_path: Path, devices: str, channels: str, outputs: str = "", more: str = "") -> Path:
    path = tmp_path / "rig.toml"
    lines = [
        'name = "cards"', "[daq]", 'driver = "ni-daqmx"', f"devices = {{ {devices} }}", more,
        "[daq.channels]", channels, "[daq.outputs]" if outputs else "", outputs,
    ]  # fmt: skip
    path.write_text("\n".join(textwrap.dedent(line) for line in lines))
    return path


@contextmanager
def _streamed(rig: Path, simulate: haploop.Mode, name: str, rate_hz: float) -> Iterator[tuple[Any, Any]]:
    """The opened DAQ, and a finite stream of one of its channels."""
    with haploop.open_rig(rig, simulate=simulate) as it, it.daq.stream([name], rate_hz, 100, 200) as stream:
        yield it.daq, stream


@BOTH
@pytest.mark.parametrize(
    ("product", "delay"), [("NI 9234", -(40 + 5 / 512) / 5120 - 2.6e-6), ("NI 9215", 0.0)]
)
def test_a_delta_sigma_input(tmp_path, simulate, product, delay):
    rig = _rig(tmp_path, f'cDAQ1Mod1 = "{product}"', 'force = { terminal = "cDAQ1Mod1/ai0", range = 5 }')
    with _streamed(rig, simulate, "force", 5000) as (_, stream):
        assert stream.rate_hz == (5120 if delay else 5000)
        assert stream.delays == pytest.approx([delay], abs=1e-9)
        assert stream.capture().volts.shape == (1, 200)


@BOTH
@pytest.mark.parametrize("product", ["PCI-6052E", "PCIe-6321"])
def test_an_old_card_plays_whole_on_its_inputs(tmp_path, simulate, product):
    """An E Series output is done one pulse after its last sample, which the inputs' clock never gives."""
    monitor = 'monitor = { terminal = "Dev1/ai0", range = 10 }'
    rig = _rig(tmp_path, f'Dev1 = "{product}"', monitor, 'out = { terminal = "Dev1/ao0" }')
    with haploop.open_rig(rig, simulate=simulate) as opened:
        volts = np.sin(np.arange(500) / 20)
        bypass_interlock(opened.daq)
        with opened.daq.stream(["monitor"], 1000, 100, 500, {"out": volts}) as stream:
            assert stream.capture().volts.shape == (1, 500)


def test_such_an_output_is_never_done_on_another_clock_of_as_many_pulses():
    import nidaqmx

    from haploop.nidaqmx_twin import NiTwin

    for product, done in (("PCI-6052E", False), ("PCI-6733", False), ("PCIe-6321", True)):
        with NiTwin({"Dev1": product, "Dev2": "PCIe-6321"}), nidaqmx.Task() as clock, nidaqmx.Task() as out:
            out.ao_channels.add_ao_voltage_chan("Dev1/ao0")
            out.timing.cfg_samp_clk_timing(1000, "/Dev2/Ctr0InternalOutput", samps_per_chan=50)
            out.write([0.1] * 50)
            clock.co_channels.add_co_pulse_chan_freq("Dev2/ctr0", freq=1000)
            clock.timing.cfg_implicit_timing(samps_per_chan=50)
            out.start()
            clock.start()
            clock.wait_until_done()
            assert out.out_stream.total_samp_per_chan_generated == 50
            if done:
                out.wait_until_done(timeout=1)
            else:
                with pytest.raises(nidaqmx.DaqError, match="-200560"):
                    out.wait_until_done(timeout=1)


@BOTH
@pytest.mark.parametrize(
    "kind", ['coupling = "ac"', "excitation = 0.002", 'bridge = "full"', 'config = "pseudodiff"']
)
def test_a_supply_the_product_has_not_is_refused(tmp_path, simulate, kind):
    channel = f'force = {{ terminal = "Dev1/ai0", range = 5, {kind} }}'
    rig = _rig(tmp_path, 'Dev1 = "PCIe-6321"', channel)
    with pytest.raises(ConfigurationError, match="-200077"), _streamed(rig, simulate, "force", 1000):
        pass


@BOTH
def test_iepe_and_bridges_are_read_in_volts_at_the_terminal(tmp_path, simulate):
    rig = _rig(
        tmp_path,
        'cDAQ1Mod1 = "NI 9234", cDAQ1Mod2 = "NI 9237"',
        """
        cap = { terminal = "cDAQ1Mod1/ai0", range = 5, coupling = "ac", excitation = 0.002 }
        cell = { terminal = "cDAQ1Mod2/ai0", range = 0.2, bridge = "full", bridge_excitation = 10 }
        """,
    )
    with haploop.open_rig(rig, simulate=simulate) as opened:
        for name, most in (("cap", 5.0), ("cell", 0.25)):
            with opened.daq.stream([name], 2000, 100, 200) as stream:
                assert stream.full_scale == pytest.approx([most])
                assert np.abs(stream.capture().volts).max() < 1e-2


@BOTH
def test_a_current_is_what_the_sensor_requires(tmp_path, simulate):
    """The card supplies what it has: 2.1 mA."""
    channel = 'cap = { terminal = "Dev1/ai0", range = 5, coupling = "ac", excitation = 0.002 }'
    rig = _rig(tmp_path, 'Dev1 = "USB-4431"', channel)
    with _streamed(rig, simulate, "cap", 2000) as (_, stream):
        assert stream.capture().volts.shape == (1, 200)


@BOTH
def test_a_play_is_refused_at_a_rate_that_the_inputs_have_not(tmp_path, simulate):
    rig = _rig(
        tmp_path,
        'cDAQ1Mod1 = "NI 9234", cDAQ1Mod2 = "NI 9263"',
        'monitor = { terminal = "cDAQ1Mod1/ai0", range = 5 }',
        'out = { terminal = "cDAQ1Mod2/ao0" }',
    )
    with haploop.open_rig(rig, simulate=simulate) as opened:
        bypass_interlock(opened.daq)
        with pytest.raises(ConfigurationError, match="such as 51200"):
            opened.daq.stream(["monitor"], 50000, 100, 200, {"out": np.zeros(200)})
        with opened.daq.stream(["monitor"], 51200, 100, 200, {"out": np.zeros(200)}) as stream:
            assert stream.capture().volts.shape == (1, 200)


@BOTH
def test_an_output_without_a_clock_is_refused(tmp_path, simulate):
    monitor = 'monitor = { terminal = "Dev1/ai0", range = 5 }'
    rig = _rig(tmp_path, 'Dev1 = "USB-6009"', monitor, 'out = { terminal = "Dev1/ao0", range = 5 }')
    with haploop.open_rig(rig, simulate=simulate) as opened:
        bypass_interlock(opened.daq)
        with pytest.raises((ConfigurationError, InstrumentError), match="no sample clock"):
            opened.daq.stream(["monitor"], 1000, 100, 200, {"out": np.zeros(200)})


@BOTH
def test_a_product_described_in_the_rig_file_is_simulated(tmp_path, simulate):
    described = '[daq.products."USB-9999"]\nlike = "USB-6211"\nai_ranges = [3.0]\nsource = "its label"'
    rig = _rig(tmp_path, 'Dev1 = "USB-9999"', 'force = { terminal = "Dev1/ai0", range = 2 }', more=described)
    with _streamed(rig, simulate, "force", 1000) as (daq, stream):
        assert stream.full_scale == pytest.approx([3.0])
        assert "USB-9999" in daq.identity


ENCODER = """
base = "usb-6211"
name = "encoder"

[daq.channels]
travel = { terminal = "Dev1/ctr0", range = 100000, counter = "encoder" }

[sensors.displacement]
channels = ["travel"]
scale = 1e-6
range = 0.01
"""


@BOTH
def test_a_cap_at_rest_stays_and_doctor_takes_an_encoder(tmp_path, simulate):
    (tmp_path / "rig.toml").write_text(ENCODER)
    with haploop.open_rig(tmp_path / "rig.toml", simulate=simulate) as opened:
        with opened.daq.stream(["travel", "force"], 5000, 100, 2000) as stream:
            assert stream.channels == ("travel", "force")
            assert (stream.full_scale[0], stream.delays[0]) == (100_000, 0)
            counts = stream.capture().volts[0]
            assert np.abs(counts).max() <= 2 and np.array_equal(counts, np.rint(counts))  # in every block
        with pytest.raises(ConfigurationError, match="stream one of those beside it"):
            opened.daq.stream(["travel"], 5000, 100, 200)
        findings = haploop.examine(opened) if simulate == "twin" else []
    assert not [finding for finding in findings if finding.status == "red"]
    floor = [finding.sentence for finding in findings if finding.name == "Noise floor of travel"]
    assert simulate == "wire" or "counts rms" in floor[0]


@pytest.mark.parametrize(("channel", "sentence"), [
    ('x = { terminal = "Dev1/ctr0", range = 10 }', "say what it counts"),
    ('x = { terminal = "Dev1/ai0", range = 10, counter = "edges" }', "is no counter"),
    ('x = { terminal = "Dev1/ai0", range = 1, bridge = "full", excitation = 0.002 }', "keep one"),
])  # fmt: skip
def test_a_channel_is_of_one_kind(tmp_path, channel, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        haploop.open_rig(_rig(tmp_path, 'Dev1 = "PCIe-6321"', channel), simulate="twin")


def test_a_call_that_waits_has_that_time_and_the_usual_one():
    from collections import namedtuple

    asked = []
    details = namedtuple("details", "timeout")(None)
    for request in (object(), _Waits(timeout=40.0), _Waits(time_to_wait=7.0), _Waits(timeout=-1.0)):
        _Deadline(15.0).intercept_unary_unary(lambda d, _r: asked.append(d.timeout), details, request)
    assert asked == [15.0, 55.0, 22.0, 15.0]


class _Waits:
    def __init__(self, **waits: float) -> None:
        self.__dict__ |= waits
