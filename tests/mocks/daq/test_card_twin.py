"""The twin that any DAQ gets by naming its channels, ranges and rate."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.instruments import Daq, load_rig_file
from haploop.instruments.conformance import DaqConformance, Fired, bypass_interlock
from haploop.mocks.daq import Card, CardTwin
from haploop.mocks.plant import Faults, Plant

SIMULATED = load_rig_file("simulated")


def card(**changes: Any) -> Card:
    figures: dict[str, Any] = {
        "name": "ACME 16",
        "channels": {"gauge0": 10.0, "laser": 5.0, "drive": 10.0},
        "outputs": {"amplifier": 8.0},
        "ai_rate_hz": 100_000.0,
    }
    return Card(**(figures | changes))


def twin(*cards: Card, faults: tuple[dict[str, Any], ...] = ()) -> CardTwin:
    world = SIMULATED.simulation.model_copy(update={"faults": faults})
    plant = Plant(SIMULATED.model_copy(update={"simulation": world}), VirtualClock())
    plant.switch("A", True, 0.0)
    daq = CardTwin(plant, *(cards or (card(),)))
    bypass_interlock(daq)
    return daq


class TestConformance(DaqConformance):
    """The suite on one card that is nobody's: amplifier, patch A and the divider lie in the loop."""

    capabilities = ("outputs", "loop")
    channels = ("gauge0", "laser", "drive")
    outputs = ("amplifier",)
    output_range = 8.0
    loop = ("amplifier", "drive")
    loop_gain = 0.5
    faults = ("daq-overrun", "daq-overflow")

    @pytest.fixture
    def daq(self) -> Daq:
        # At once, before the amplifier in the loop has moved: between two values the wave is not known again.
        self.twin = twin(card(ai_simultaneous=True))
        return self.twin

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        world = SIMULATED.simulation.model_copy(update={"faults": ({"kind": kind},)})
        plant = self.twin._plant
        plant.faults = Faults.of_file(SIMULATED.model_copy(update={"simulation": world}))
        yield plant.faults[0]


def test_its_channels_come_one_after_the_other_unless_each_has_a_converter():
    for figures, apart in (({}, 1e-5), ({"ai_simultaneous": True}, 0.0)):
        with twin(card(**figures)).stream(["gauge0", "laser", "drive"], 1000, 50, 50) as stream:
            assert stream.delays == pytest.approx(apart * np.arange(3), abs=1e-12)
            assert stream.full_scale.tolist() == [10.0, 5.0, 10.0]


@pytest.mark.parametrize(
    ("figures", "rate_hz", "channels", "says"),
    [
        ({}, 40_000.0, 3,
         "ACME 16 converts 100000 samples per second, and 3 channels at 40000 Hz need 120000"),
        ({}, 100_001.0, 1, "1 channels at 100001 Hz need 100001"),
        ({"ai_simultaneous": True}, 100_001.0, 3, "need 100001: lower the rate"),
        ({"rates_hz": (44_100.0, 48_000.0)}, 50_000.0, 1,
         "samples at 44100, 48000 Hz, and 50000 Hz were asked"),
    ],
)  # fmt: skip
def test_a_rate_that_the_card_has_not_is_refused(figures, rate_hz, channels, says):
    with pytest.raises(ConfigurationError, match=says):
        twin(card(**figures)).stream(["gauge0", "laser", "drive"][:channels], rate_hz, 50, 50)


def test_one_of_its_rates_and_one_channel_alone_are_taken():
    for figures, rate_hz, names in (
        ({"rates_hz": (48_000.0,), "ai_simultaneous": True}, 48_000.0, ["gauge0", "laser"]),
        ({"ai_rate_single_hz": 200_000.0}, 200_000.0, ["laser"]),
        ({"ai_simultaneous": True}, 100_000.0, ["gauge0", "laser", "drive"]),
    ):
        with twin(card(**figures)).stream(names, rate_hz, 50, 50) as stream:
            assert stream.capture().volts.shape == (len(names), 50)


def test_an_output_of_one_sign_refuses_the_other():
    daq = twin(card(ao_unipolar=True))
    with pytest.raises(LimitError, match="leaves the output's range of 0 to 8 V"):
        daq.stream(["drive"], 1000, 50, 50, {"amplifier": np.full(50, -0.1)})
    with daq.stream(["drive"], 1000, 50, 50, {"amplifier": np.full(50, 0.1)}) as stream:
        stream.capture()


def test_its_converters_round_and_have_noise_as_they_are_described():
    fine = twin(card(ai_bits=12, ai_noise=0.0))
    with fine.stream(["gauge0"], 1000, 100, 100) as stream:
        codes = stream.capture().volts / (10 / 2**11)
    assert codes == pytest.approx(np.rint(codes), abs=1e-9)
    with twin(card(channels={"nothing": 10.0}, ai_noise=0.05)).stream(
        ["nothing"], 5000, 5000, 5000
    ) as stream:
        assert stream.capture().volts.std() == pytest.approx(0.05, rel=0.05)


def test_faults_of_cards_strike_it_by_the_name_of_its_device():
    other = card(name="ACME 2", channels={"laser": 5.0}, outputs={}, device="Dev2")
    first = card(device="Dev1", channels={"gauge0": 10.0, "drive": 10.0})
    daq = twin(first, other, faults=({"kind": "daq-overrun", "device": "Dev2"},))
    assert daq.identity == "ACME 16 (Dev1, twin) + ACME 2 (Dev2, twin)"
    assert dict(daq.cards(["drive", "laser", "gauge0"])) == {"Dev1": ["drive", "gauge0"], "Dev2": ["laser"]}
    with daq.stream(["gauge0"], 1000, 50, 50) as stream:
        stream.capture()
    with (
        daq.stream(["gauge0", "laser"], 1000, 50, 50) as stream,
        pytest.raises(InstrumentError, match=r"^Dev2 lost samples"),
    ):
        stream.capture()


def test_a_play_that_is_cut_off_is_an_error_in_the_cards_own_words():
    daq = twin(faults=({"kind": "play-cut-off"},))
    with (
        daq.stream(["drive"], 1000, 50, 100, {"amplifier": np.ones(100)}) as stream,
        pytest.raises(InstrumentError, match=r"^ACME 16 stopped playing when it had played 50 samples"),
    ):
        stream.capture()
