"""Ways to bring blocks of 16 channels to a disk: haploop's, the disk's own, and those of what people use.

Each takes a folder and blocks, and brings all of them to the disk; those that do not ask the disk to keep
what they wrote are followed by an fsync, so that every way ends with the data on it. A way yields between
getting ready and recording: only what comes after that is timed.
"""

from __future__ import annotations

import importlib.util
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from haploop.acquisition.recording.file_format import Header
from haploop.acquisition.recording.writer import Writer
from haploop.instruments import Block, load_rig_file

CHANNELS = 16
NAMES = tuple(f"channel{i}" for i in range(CHANNELS))
FULL_SCALE = np.full(CHANNELS, 10.0)
NONE = np.zeros(CHANNELS, dtype=bool)


def header(rate_hz: float) -> Header:
    return Header(
        button="push",
        participant="P01",
        presses=100,
        rig_name="benchmark",
        simulated=True,
        rate_hz=rate_hz,
        channels=NAMES,
        full_scale=FULL_SCALE,
        delays=np.zeros(CHANNELS),
        rest=0.5,
        rig=load_rig_file("simulated").model_dump_json(),
        daq="none",
        software="benchmark",
        started="2026-01-01T00:00:00+00:00",
    )


class Material:
    """A few different blocks of one size, as codes, volts and bytes, to be used again and again."""

    def __init__(self, samples: int, count: int = 8) -> None:
        rng = np.random.default_rng(0)
        self.samples = samples
        self.codes = [rng.integers(-30000, 30000, (CHANNELS, samples)).astype(np.int16) for _ in range(count)]
        self.volts = [codes * (FULL_SCALE / 32768)[:, None] for codes in self.codes]
        self.bytes = [codes.tobytes() for codes in self.codes]

    def block(self, number: int) -> Block:
        return Block(number * self.samples, self.volts[number % len(self.volts)], NONE)


Way = Callable[[Path, Material, int], Iterator[None]]


@dataclass(frozen=True)
class Contestant:
    name: str
    record: Way
    part: float = 1.0
    """Fraction of the blocks it gets: a slow one does not need a gigabyte."""


def raw(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    file = os.open(folder / "raw.bin", os.O_RDWR | os.O_CREAT | os.O_EXCL)
    yield
    for i in range(blocks):
        os.write(file, material.bytes[i % len(material.bytes)])
    os.fsync(file)
    os.close(file)


def haploop(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    """Everything: volts to codes, ranges, CRC, one write a block, commits, and the closing fsync."""
    writer = Writer(folder / "P01-push.h5", header(5000.0), material.samples, blocks)
    yield
    with writer:
        for i in range(blocks):
            writer.write(material.block(i), 0.0)


def h5py_flush(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    yield from _h5py(folder, material, blocks, flush=True)


def h5py_append(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    yield from _h5py(folder, material, blocks, flush=False)


def _h5py(folder: Path, material: Material, blocks: int, flush: bool) -> Iterator[None]:
    path = folder / "append.h5"
    with h5py.File(path, "w") as file:
        data = file.create_dataset(
            "codes",
            (CHANNELS, 0),
            "i2",
            maxshape=(CHANNELS, None),
            chunks=(CHANNELS, material.samples),
        )
        yield
        for i in range(blocks):
            data.resize((i + 1) * material.samples, axis=1)
            data[:, i * material.samples :] = material.codes[i % len(material.codes)]
            if flush:
                file.flush()
    _sync(path)


def pytables_flush(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    yield from _pytables(folder, material, blocks, flush=True)


def pytables_append(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    yield from _pytables(folder, material, blocks, flush=False)


def _pytables(folder: Path, material: Material, blocks: int, flush: bool) -> Iterator[None]:
    import tables

    path = folder / "array.h5"
    with tables.open_file(path, "w") as file:
        shape = (CHANNELS, material.samples)
        array = file.create_earray(
            "/", "codes", tables.Int16Atom(), (CHANNELS, 0), expectedrows=blocks, chunkshape=shape
        )
        yield
        for i in range(blocks):
            array.append(material.codes[i % len(material.codes)])
            if flush:
                array.flush()
    _sync(path)


def nptdms(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "data.tdms"
    with TdmsWriter(path) as writer:
        yield
        for i in range(blocks):
            codes = material.codes[i % len(material.codes)]
            writer.write_segment(
                [ChannelObject("group", n, row) for n, row in zip(NAMES, codes, strict=True)]
            )
    _sync(path)


def qcodes(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    import qcodes.dataset as data

    path = folder / "qcodes.db"
    data.initialise_or_create_database_at(path)
    data.load_or_create_experiment("benchmark", "none")
    measurement = data.Measurement()
    measurement.register_custom_parameter("volts", paramtype="array")
    with _quiet(), measurement.run() as saver:
        yield
        for i in range(blocks):
            saver.add_result(("volts", material.volts[i % len(material.volts)]))
            saver.flush_data_to_database()
    saver.dataset.conn.close()
    _sync(path)


def pymeasure(folder: Path, material: Material, blocks: int) -> Iterator[None]:
    from queue import Queue

    from pymeasure.experiment import Procedure, Results
    from pymeasure.experiment.listeners import Recorder

    streaming = type("Streaming", (Procedure,), {"DATA_COLUMNS": list(NAMES)})

    path = folder / "data.csv"
    results = Results(streaming(), str(path))
    queue: Queue[dict[str, float]] = Queue()
    recorder = Recorder(results, queue)
    recorder.start()
    yield
    for i in range(blocks):
        for sample in material.volts[i % len(material.volts)].T:
            queue.put(dict(zip(NAMES, sample.tolist(), strict=True)))
    recorder.stop()
    _sync(path)


CONTESTANTS = (
    Contestant("haploop", haploop),
    Contestant("h5py, append", h5py_append),
    Contestant("h5py, append and flush", h5py_flush),
    *(
        Contestant(name, way, part)
        for module, name, way, part in (
            ("tables", "PyTables, append", pytables_append, 1.0),
            ("tables", "PyTables, append and flush", pytables_flush, 1.0),
            ("nptdms", "npTDMS", nptdms, 1.0),
            ("qcodes", "QCoDeS, arrays to its data set", qcodes, 0.05),
            ("pymeasure", "PyMeasure, CSV results", pymeasure, 0.005),
        )
        if importlib.util.find_spec(module)
    ),
)


def _sync(path: Path) -> None:
    with path.open("r+b") as file:
        os.fsync(file.fileno())


@contextmanager
def _quiet() -> Iterator[None]:
    import contextlib
    import io

    logging.disable(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):
        yield
    logging.disable(logging.NOTSET)
