"""The NI driver, through the real nidaqmx package, against its wire and a plant of two nodes."""

from collections import Counter
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.system import System

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.daq.ni_sentences import CONFIGURATION, SENTENCES
from haploop.nidaqmx_twin import NiServer, inventory_of
from haploop.nidaqmx_twin.devices import NiDevice
from haploop.nidaqmx_twin.products import PRODUCTS, convert_interval
from haploop.nidaqmx_twin.tasks import Task
from tests.instruments.daq.conftest import CARDS, LSB, WIRING, opened, settings, tone
from tests.nidaqmx_twin.ni_client import Bench, connected


def test_every_sentence_is_of_a_number_that_the_library_knows_and_says_it():
    for code, sentence in {**SENTENCES, **CONFIGURATION}.items():
        assert DAQmxErrors(code) and f"({code})" in sentence


def test_identity(daq, server):
    first = 0x1000000 + 256 * server.port
    assert daq.identity == f"PCI-6034E (Dev1, serial {first:X}) + PCIe-6321 (Dev2, serial {first + 1:X})"


def test_a_card_is_one_piece_under_every_address(server, monkeypatch):
    first = 0x1000000 + 256 * server.port
    cards = {f"PCI-6034E {first:X}", f"PCIe-6321 {first + 1:X}"}
    for address in (server.address, f"localhost:{server.port}", f"ipv4:{server.address}"):
        assert set(NiDaq.hardware(settings(server=address))) == cards
    with connected(server) as options:
        remote = System.remote(options)
        monkeypatch.setattr(System, "local", lambda: remote)
        assert set(NiDaq.hardware(settings())) == cards
    names = {"Old": "PCI-6034E", "Dev2": "PCIe-6321"}
    renamed = [NiDevice(name, PRODUCTS[of], first + k) for k, (name, of) in enumerate(names.items())]
    with NiServer(renamed) as other:
        terminal = {"force": {"terminal": "OLD/ai0", "range": 10}}
        asked = settings(server=other.address, channels=terminal, devices={})
        assert set(NiDaq.hardware(asked)) == cards


def test_a_module_is_locked_with_its_chassis():
    chassis = NiDevice("cDAQ1", PRODUCTS["cDAQ-9178"], 0x1A2B)
    modules = [
        NiDevice(f"cDAQ1Mod{slot}", PRODUCTS["NI 9215"], 0x3C00 + slot, chassis="cDAQ1", slot=slot)
        for slot in (1, 2)
    ]
    with NiServer([chassis, *modules]) as server:
        own = {"server": server.address, "outputs": {}, "devices": {}}
        forces = [{"force": {"terminal": f"{module.name}/ai0", "range": 5}} for module in modules]
        pieces = [set(NiDaq.hardware(settings(channels=force, **own))) for force in forces]
    assert pieces == [{"cDAQ-9178 1A2B", "NI 9215 3C01"}, {"cDAQ-9178 1A2B", "NI 9215 3C02"}]


def test_a_card_without_a_number_is_known_by_its_name_and_server(server):
    """As one that NI's driver simulates may be, one that is not there, and all while nobody answers."""
    with NiServer([NiDevice("Dev1", PRODUCTS["PCI-6034E"], 0)]) as other:
        asked = settings(server=other.address)
        named = {f"{other.address} dev1", f"{other.address} dev2"}
        assert set(NiDaq.hardware(asked)) == named
    assert set(NiDaq.hardware(asked)) == named
    server.corrupt(lambda _call, _reply: b"\xff" * 9)
    at = server.address
    assert set(NiDaq.hardware(settings(server=at))) == {f"{at} dev1", f"{at} dev2"}


def test_rows_come_in_the_order_asked_for_with_their_delays(daq, bench):
    start = bench.clock.now()
    with daq.stream(["laser", "torque", "drive", "force"], 5000, 500, 1800) as stream:
        capture = stream.capture()

    old, new = (convert_interval(PRODUCTS[product], 5000, 2) for product in CARDS.values())
    assert (old, new) == pytest.approx((15e-6, 14e-6))
    assert stream.delays == pytest.approx([0, 0, new, old])
    assert stream.full_scale.tolist() == [5, 5, 10, 10]
    assert capture.volts.shape == (4, 1800) and capture.rate_hz == 5000
    for row in (0, 1, 3):
        expected = tone(start, 5000, 1800, stream.delays[row])
        assert np.abs(capture.volts[row] - expected).max() < 6 * LSB
    assert not capture.overload.any()


@pytest.mark.parametrize(("reach", "unipolar"), [(3.5, False), (5.0, True)])
def test_a_card_with_a_range_of_its_own_goes_to_zero_and_plays(bench, monkeypatch, reach, unipolar):
    """In the library's default of +-10 V it would refuse, as would one whose outputs begin at 0 V."""
    changed = replace(PRODUCTS["PCIe-6321"], ao_range=reach, ao_unipolar=unipolar)
    monkeypatch.setitem(PRODUCTS, "PCIe-6321", changed)
    outputs = {"amplifier": {"terminal": "Dev2/ao0", "range": reach}}
    with (
        NiServer(inventory_of(CARDS), bench, WIRING, rtsi=True) as card,
        opened(card, bench, outputs=outputs) as daq,
    ):
        daq.zero()
        with daq.stream(["laser"], 5000, 100, 200, {"amplifier": np.full(100, 2.0)}) as stream:
            stream.capture()
            assert card.output("Dev2/ao0") == pytest.approx(2.0, abs=1e-3)
        assert card.output("Dev2/ao0") == 0.0
        if unipolar:
            with pytest.raises(ConfigurationError, match=r"\(-200561\)"):
                daq.stream(["laser"], 5000, 100, 200, {"amplifier": np.full(100, -2.0)})
        daq.zero()


@pytest.mark.long
@pytest.mark.parametrize(
    ("master", "other"), [("PCIe-6321", "PCI-6034E"), ("PCIe-6363", "PCIe-6321"), ("PCIe-6321", "PCIe-6363")]
)
def test_awkward_rates_on_every_pair_of_products(master, other, bench):
    """Outputs too run on the master's clock: what is played is read sample by sample."""
    cards = {"Dev1": other, "Dev2": master}
    wave = np.random.default_rng(1).uniform(-3, 3, 300)
    with (
        NiServer(inventory_of(cards), bench, WIRING, rtsi=True) as server,
        opened(server, bench, devices=cards) as daq,
    ):
        for rate_hz in (997, 44_100, 51_200):
            with daq.stream(["drive", "force"], rate_hz, 128, 400, {"amplifier": wave}) as stream:
                volts = stream.capture().volts
            with daq.stream(["drive"], rate_hz, 128, 400) as alone:
                assert alone.rate_hz == stream.rate_hz, "the other card samples on the master's clock"
            divisor = int(100e6 / rate_hz)  # rounded down, as for every analog input
            assert stream.rate_hz == pytest.approx(100e6 / divisor, rel=1e-12)
            assert np.abs(volts[0, :300] - wave).max() < 7 * LSB
            # After its last sample the output holds it.
            assert np.abs(volts[0, 300:] - wave[-1]).max() < 7 * LSB


def test_a_card_with_another_rate_of_one_clock_is_refused(daq, monkeypatch):
    made = Task.rate_hz.fget
    assert made is not None

    def coerced(task: Task) -> float:
        return made(task) * (1 + 3e-4 * (task.device.name == "Dev1"))

    monkeypatch.setattr(Task, "rate_hz", property(coerced))
    with pytest.raises(ConfigurationError, match=r"Dev1 would sample at 5001.5 Hz on the clock of Dev2"):
        daq.stream(["drive", "force"], 5000, 100, 200)


def test_a_play_that_somebody_stops_is_an_error(daq, server):
    """Another client of the server stops the task of the outputs, between two blocks and before the last."""
    wave = np.full(50_000, 3.0)
    for at in (20_000, 49_000):
        told = pytest.raises(
            InstrumentError, match=rf"Dev2 was stopped .* played {at} samples: .* not .* whole"
        )
        with daq.stream(["drive"], 50_000, 1000, 50_010, {"amplifier": wave}) as stream, told:
            for block in stream:
                if block.end == at:
                    system = server._system
                    with system.lock:
                        system.stop(next(t for n, t in system.tasks.items() if n.endswith("Dev2 output")))


def test_counts_are_compared_once_a_second(daq, monkeypatch):
    asked = []
    real = nidaqmx.task.InStream.total_samp_per_chan_acquired.fget
    more = {"by": 0}

    def counted(stream: Any) -> int:
        asked.append(stream)
        return int(real(stream)) + more["by"] * (len(asked) % 3 == 2)

    monkeypatch.setattr(nidaqmx.task.InStream, "total_samp_per_chan_acquired", property(counted))
    with daq.stream(("force", "laser"), 5000, 500) as stream:
        blocks = iter(stream)
        for _ in range(25):
            next(blocks)
        # Two cards, of which the master is asked twice, at 1 s and at 2 s.
        assert len(asked) == 6
        more["by"] = 5000
        with pytest.raises(InstrumentError, match="do not run on one clock"):
            for _ in range(10):
                next(blocks)


def test_waveform_on_the_clock_of_another_card(daq):
    """No input on the card of the output: its outputs then run on the other card's sample clock."""
    wave = np.linspace(0, 1, 200)

    with daq.stream(["force"], 5000, 100, 300, {"amplifier": wave}) as stream:
        assert stream.capture().volts.shape == (1, 300)


def test_same_seed_gives_the_same_samples_however_they_are_cut():
    captures = []
    for block in (50, 333):
        bench = Bench()
        with (
            NiServer(inventory_of(CARDS), bench, WIRING, rtsi=True, seed=5) as server,
            opened(server, bench) as daq,
            daq.stream(["laser", "force"], 5000, block, 1000) as stream,
        ):
            captures.append(stream.capture().volts)

    assert np.array_equal(*captures)


def test_overload_is_told_per_channel(daq):
    wave = np.full(400, 7.0)

    with daq.stream(["drive", "echo"], 5000, 100, 300, {"amplifier": wave}) as stream:
        assert stream.full_scale.tolist() == [10, 5]
        assert stream.capture().overload.tolist() == [False, True]


def test_the_version_is_asked_once(server, bench, monkeypatch):
    """nidaqmx asks for each task, which makes a drive late that begins with a press."""
    asked: Counter[str] = Counter()
    connect = grpc.insecure_channel

    class Asked(grpc.UnaryUnaryClientInterceptor):
        def intercept_unary_unary(self, continuation: Any, details: Any, request: Any) -> Any:
            asked[details.method.rpartition("/")[2]] += 1
            return continuation(details, request)

    def watched(*where: Any, **how: Any) -> Any:
        return grpc.intercept_channel(connect(*where, **how), Asked())

    monkeypatch.setattr(grpc, "insecure_channel", watched)
    with opened(server, bench) as daq:
        daq.zero()
        daq.zero()
    assert asked["CreateTask"] >= 2
    assert asked["GetSystemInfoAttributeUInt32"] <= 3, "three numbers, once each"


@pytest.mark.parametrize(("fault", "sentence"), [
    (DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE, "Dev2 lost samples, .* not read in time"),
    (DAQmxErrors.INPUT_FIFO_OVERFLOW, "Dev2 lost samples, .* memory overflowed"),
    (DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, "Dev2 did not deliver"),
    (DAQmxErrors.INVALID_TASK, "ended by somebody else"),
])  # fmt: skip
def test_lost_samples_are_an_error(daq, server, fault, sentence):
    with daq.stream(["laser"], 5000, 100, 1000) as stream:
        blocks = iter(stream)
        next(blocks)
        server.inject("Dev2", fault)
        with pytest.raises(InstrumentError, match=sentence):
            next(blocks)


def test_reader_that_comes_too_late(server, bench):
    too_late = pytest.raises(InstrumentError, match=r"make buffer_s in \[daq\] larger")
    for buffer_s, end in ((0.1, too_late), (1, nullcontext())):
        with opened(server, bench, buffer_s=buffer_s) as daq, daq.stream(["laser"], 5000, 100) as stream:
            blocks = iter(stream)
            next(blocks)
            bench.clock.sleep(0.2)
            with end:
                assert next(blocks).first == 100


@pytest.mark.long
@pytest.mark.parametrize("inputs", ["NI 9215", "NI 9205", "NI 9775"])
def test_modules_of_one_chassis(bench, inputs):
    """Inputs in one slot, outputs in another: the chassis has the clock, at awkward rates too."""
    chassis = {"Frame": "cDAQ-9178", "In": inputs, "Out": "NI 9263"}
    plain = inventory_of(chassis).devices
    modules = [
        replace(device, chassis="Frame", slot=slot) if device.name != "Frame" else device
        for slot, device in enumerate(plain.values())
    ]
    wiring = {"In/ai0": "tone", "In/ai3": "loop", "Out/ao1": "out"}
    table = {
        "channels": {
            "laser": {"terminal": "In/ai0", "range": 10},
            "drive": {"terminal": "In/ai3", "range": 10},
        },
        "outputs": {"amplifier": {"terminal": "Out/ao1"}},
        "devices": {"In": inputs, "Out": "NI 9263"},
    }
    product = PRODUCTS[inputs]
    step = 20 / 2**product.ai_bits
    wave = np.random.default_rng(1).uniform(-3, 3, 500)
    with NiServer(modules, bench, wiring) as server:
        daq = NiDaq.open(NiDaq.Settings.model_validate({**table, "server": server.address}), bench.clock)
        bypass_interlock(daq)
        for rate_hz in (997, 12_800, 51_200):
            with daq.stream(["drive", "laser"], rate_hz, 100, 600, {"amplifier": wave}) as stream:
                capture = stream.capture()
            assert stream.rate_hz == capture.rate_hz == pytest.approx(rate_hz, rel=1e-3)
            assert (stream.delays.tolist() == [0, 0]) == product.ai_simultaneous
            assert np.abs(capture.volts[0, :500] - wave).max() < 8 * product.ai_noise + step
        daq.close()
