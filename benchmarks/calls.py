"""Calls of nidaqmx to a simulated card in one process, and through gRPC.

python -m benchmarks.calls                              # half a minute
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import grpc
import nidaqmx
from nidaqmx.constants import AcquisitionType

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.table import Row, markdown, ratios
from haploop.nidaqmx_twin import NiTwin

_clock = time.perf_counter  # the card's own time is virtual


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Time each kind of call both ways in turn, print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.5, help="for each kind of call in a round")
    asked = parser.parse_args(words)
    found = [[_round(direct, asked.seconds) for direct in (True, False)] for _ in range(asked.rounds)]
    rows = []
    for what in found[0][0]:
        direct, plain = ([both[way][what] for both in found] for way in (0, 1))
        rows.append(Row(what, direct, "/s", "through gRPC", ratios(direct, plain), more=True))
    print(markdown(rows))
    return rows


def _round(direct: bool, seconds: float) -> dict[str, float]:
    with NiTwin({"Dev1": "PCIe-6363"}) as twin:
        twin.set("Dev1/ai0", 1.0)
        options = None if direct else nidaqmx.GrpcSessionOptions(grpc.insecure_channel(twin.address), "")
        with nidaqmx.Task(grpc_options=options) as one, nidaqmx.Task(grpc_options=options) as eight:
            channel = one.ai_channels.add_ai_voltage_chan("Dev1/ai8")
            eight.ai_channels.add_ai_voltage_chan("Dev1/ai0:7")
            eight.timing.cfg_samp_clk_timing(
                1e4, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=100_000
            )
            found = {
                "property of a channel": _rate(lambda: channel.ai_max, seconds),
                "read of one value, unclocked": _rate(one.read, seconds),
            }
            eight.start()
            found["read of 100 samples of 8 channels"] = _rate(lambda: eight.read(100), seconds)
        found["task of 100 samples, from its making to its end"] = _rate(lambda: _task(options), seconds)
    return found


def _task(options: nidaqmx.GrpcSessionOptions | None) -> None:
    with nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=100)
        task.read(100)


def _rate(act: Callable[[], object], seconds: float) -> float:
    act()
    began, count = _clock(), 0
    while _clock() - began < seconds:
        act()
        count += 1
    return count / (_clock() - began)


if __name__ == "__main__":
    main()
