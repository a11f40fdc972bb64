"""Digital lines and ports on the wire."""

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import LineGrouping
from nidaqmx.stream_readers import DigitalSingleChannelReader
from nidaqmx.stream_writers import DigitalMultiChannelWriter, DigitalSingleChannelWriter
from nitypes.waveform import DigitalWaveform

from haploop.nidaqmx_twin import NiTwin

TOGETHER, EACH = LineGrouping.CHAN_FOR_ALL_LINES, LineGrouping.CHAN_PER_LINE


@pytest.mark.parametrize(
    "lines, grouping, assigned, names",
    [
        ("Sim/port0/line0", TOGETHER, "", ["Sim/port0/line0"]),
        ("Sim/port0/line0:1", EACH, "", ["Sim/port0/line0", "Sim/port0/line1"]),
        ("Sim/port0/line0:1", TOGETHER, "", ["Sim/port0/line0..."]),
        ("Sim/port0/line0:1", EACH, "button", ["button0", "button1"]),
        ("Sim/port0/line0:7", TOGETHER, "button", ["button"]),
        ("Sim/port1", TOGETHER, "", ["Sim/port1"]),
        ("Sim/port1", EACH, "", [f"Sim/port1/line{i}" for i in range(8)]),
    ],
)
def test_names(task, lines, grouping, assigned, names):
    task.di_channels.add_di_chan(lines, assigned, grouping)
    assert task.channel_names == names
    assert task.number_of_channels == len(names)


def test_simulated_lines_count(task, other):
    task.di_channels.add_di_chan("Sim/port0/line7:0", line_grouping=TOGETHER)
    reader = DigitalSingleChannelReader(task.in_stream)
    lines = np.zeros(8, dtype=bool)
    counted = []
    for _ in range(20):
        reader.read_one_sample_multi_line(lines)
        counted.append(int(np.packbits(lines, bitorder="little")[0]))
    assert counted == list(range(20))
    other.di_channels.add_di_chan("Sim/port0/line0:2", line_grouping=EACH)
    assert np.array(other.read(4)).tolist() == [
        [False, True, False, True],
        [False, False, True, True],
        [False, False, False, False],
    ]


@pytest.mark.parametrize(
    "port, method, dtype, all_of",
    [(1, "byte", "uint8", 1), (2, "uint16", "uint16", 1), (0, "uint32", "uint32", 0x01010101)],
)
def test_ports_count_in_groups_of_eight(task, port, method, dtype, all_of):
    task.di_channels.add_di_chan(f"Sim/port{port}", line_grouping=TOGETHER)
    reader = DigitalSingleChannelReader(task.in_stream)
    data = np.zeros(256, dtype=dtype)
    assert getattr(reader, f"read_many_sample_port_{method}")(data, 256) == 256
    assert data.tolist() == [all_of * k for k in range(256)]


def test_clocked_waveforms(task):
    """Columns go down a whole port, and follow named lines."""
    task.di_channels.add_di_chan("Sim/port0/line2:1", "pair", TOGETHER)
    task.timing.cfg_samp_clk_timing(1000, samps_per_chan=50)
    waveform = task.read_waveform(100)
    assert waveform.sample_count == 50 and waveform.channel_name == "pair"
    assert waveform.data[:8].tolist() == [
        [0, 0], [0, 0], [0, 1], [0, 1], [1, 0], [1, 0], [1, 1], [1, 1]
    ]  # fmt: skip
    assert [s.name for s in waveform.signals] == ["Sim/port0/line1", "Sim/port0/line2"]
    assert waveform.signals[0].data[:4].tolist() == [0, 0, 1, 1]
    assert waveform.timing.sample_interval.total_seconds() == 1e-3
    with NiTwin({"Hs": "PCIe-6535"}), nidaqmx.Task() as other:
        other.di_channels.add_di_chan("Hs/port0/line2:0, Hs/port1", line_grouping=TOGETHER)
        other.timing.cfg_samp_clk_timing(1000, samps_per_chan=10)
        waveform = other.read_waveform(10)
    columns = ["".join(str(int(bit)) for bit in sample) for sample in waveform.data]
    assert (columns[1], columns[6]) == ("00100000001", "11000000110")
    assert (waveform.signals[0].name, waveform.signals[10].name) == ("Hs/port1/line0", "Hs/port0/line2")


@pytest.mark.parametrize("device", ["Card", "Sim"])
def test_a_line_reads_what_drives_it(task, other, device):
    task.do_channels.add_do_chan(f"{device}/port0/line7:0", line_grouping=TOGETHER)
    other.di_channels.add_di_chan(f"{device}/port0/line0:7", line_grouping=TOGETHER)
    other.di_channels.all.di_tristate = False
    task.start()
    other.start()
    writer = DigitalSingleChannelWriter(task.out_stream)
    for value in (0, 1, 0x5A, 0xFF):
        writer.write_one_sample_multi_line(np.unpackbits(np.uint8([value]), bitorder="little").astype(bool))
        assert other.read() == value
    task.write(0x81)
    assert other.read() == 0x81
    task.stop()
    # Nobody drives the lines any more: a card holds its last state, a simulated one counts again.
    assert (other.read() == other.read()) is (device == "Card")


@pytest.mark.parametrize("method, dtype", [("byte", "uint8"), ("uint16", "uint16"), ("uint32", "uint32")])
def test_ports_write(task, other, method, dtype):
    for port in (1, 2):
        task.do_channels.add_do_chan(f"Card/port{port}", line_grouping=TOGETHER)
        other.di_channels.add_di_chan(f"Card/port{port}", line_grouping=TOGETHER)
    task.start()
    data = np.array([[1, 2, 3], [4, 5, 0xA5]], dtype=dtype)
    assert getattr(DigitalMultiChannelWriter(task.out_stream), f"write_many_sample_port_{method}")(data) == 3
    assert other.read() == [3, 0xA5]


def test_a_waveform_of_a_port_is_written_from_its_highest_line_down_and_read_back(task, other):
    task.do_channels.add_do_chan("Card/port1", line_grouping=TOGETHER)
    other.di_channels.add_di_chan("Card/port1", line_grouping=TOGETHER)
    task.start()
    waveform = DigitalWaveform(1, 8)
    waveform.data[0] = [0, 1, 0, 0, 1, 0, 1, 1]
    assert DigitalSingleChannelWriter(task.out_stream).write_waveform(waveform) == 1
    assert other.read() == task.read() == 0b01001011
    task.write(0x5A)
    assert task.read(3) == [0x5A] * 3
    with pytest.raises(nidaqmx.DaqError, match="number of lines in the data"):
        DigitalSingleChannelWriter(task.out_stream).write_waveform(DigitalWaveform(4, 3))
