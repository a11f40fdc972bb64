"""What the twin does not serve is said: the page of all properties and calls, and each way of saying so."""

import warnings

import nidaqmx
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import CJCSource, Signal
from nidaqmx.errors import DaqError, DaqFunctionNotSupportedError

from tests.nidaqmx_twin.ni_client import FINITE, clocked
from tests.nidaqmx_twin.served_list import PAGE, REFUSED, call_status, calls, page


@pytest.mark.skipif(not PAGE.is_file(), reason="the page is one of haploop's")
def test_the_page_is_that_of_the_installed_nidaqmx():
    """After a new nidaqmx: `python -m tests.nidaqmx_twin.served_list`, and look at what is new."""
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_call_that_is_refused_fails_aloud(nidaqmx_twin):
    refused = [name for name in calls() if call_status(name) == REFUSED]
    with nidaqmx.Task() as task:
        interpreter = task._interpreter
        for name in refused:
            request = getattr(pb, f"{name}Request")()
            with pytest.raises(DaqFunctionNotSupportedError, match=f"does not serve {name}"):
                interpreter._invoke(getattr(interpreter._client, name), request)


def test_a_kept_property_is_told_of_at_the_start(nidaqmx_twin):
    with nidaqmx.Task() as task, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        channel = clocked(task, "Dev1/ai0", 1000, samps_per_chan=10)
        task.read(10)
        assert not told
        channel.ai_lowpass_enable = True
        assert channel.ai_lowpass_enable
        task.triggers.pause_trigger.dig_lvl_src = "/Dev1/PFI0"
        task.read(10)
    (one,) = told
    assert "AI_LOWPASS_ENABLE" in str(one.message) and "DIG_LVL_PAUSE_TRIG_SRC" in str(one.message)


def test_volts_are_not_shown_as_degrees(nidaqmx_twin):
    def read():
        with nidaqmx.Task() as task:
            task.ai_channels.add_ai_thrmcpl_chan("Dev1/ai0", cjc_source=CJCSource.CONSTANT_USER_VALUE)
            return float(task.read())

    read()  # as NI's simulated devices: a sine in degrees
    nidaqmx_twin.set("Dev1/ai0", 0.01)
    with pytest.raises(DaqError) as refused:
        read()
    assert refused.value.error_code == -200197 and "TEMPERATURE_THERMOCOUPLE" in str(refused.value)


def test_an_exported_clock_stands_at_its_terminal(nidaqmx_twin):
    with nidaqmx.Task() as source, nidaqmx.Task() as count:
        clocked(source, "Dev1/ai0", 1000, sample_mode=FINITE, samps_per_chan=100)
        source.export_signals.export_signal(Signal.SAMPLE_CLOCK, "/Dev1/PFI5")
        count.ci_channels.add_ci_count_edges_chan("Dev1/ctr1").ci_count_edges_term = "/Dev1/PFI5"
        count.start()
        source.start()
        source.wait_until_done()
        nidaqmx_twin.sleep(1)
        assert count.read() == 100, "a finite clock ends"
        source.stop()
        assert count.read() == 100
