"""The sound card's driver on the real sounddevice: JACK's dummy card, with output 1 wired to input 1.

A program of its own, because PortAudio looks for devices once. It prints what it measured, as JSON.
"""

import json
import subprocess
import sys
import threading

import numpy as np

from haploop.base.clock import RealClock
from haploop.instruments.conformance import bypass_interlock
from haploop.instruments.daq.sound_card import SoundCardDaq

RATE = 48_000.0
QUIET = 0.4
"""Silence (s) at the beginning of a waveform, in which the cable is plugged."""


def plug(stop: threading.Event) -> None:
    """Wire the first output of every client of PortAudio to its first input, as they come."""
    while not stop.wait(0.02):
        ports = subprocess.run(["jack_lsp"], capture_output=True, text=True, check=False).stdout.split()
        outs = [port for port in ports if port.startswith("PortAudio:out")][:1]
        for out, into in zip(outs, [p for p in ports if p.startswith("PortAudio:in")], strict=False):
            subprocess.run(["jack_connect", out, into], capture_output=True, check=False)


def opened(latency: int, **changes: object) -> SoundCardDaq:
    settings = {
        "device": "system, JACK Audio Connection Kit",
        "channels": {
            "heard": {"input": 1, "volts_per_full_scale": 2.0, "high_pass_hz": 0},
            "silent": {"input": 2, "volts_per_full_scale": 2.0, "high_pass_hz": 0},
        },
        "outputs": {"out": {"output": 1, "volts_per_full_scale": 2.0, "high_pass_hz": 0, "highest": 1.5}},
        "latency": latency,
        **changes,
    }
    daq = SoundCardDaq.open(SoundCardDaq.Settings.model_validate(settings), RealClock())
    bypass_interlock(daq)
    return daq


def main() -> None:
    t = np.arange(round(0.2 * RATE)) / RATE
    burst = 1.2 * np.sin(2 * np.pi * 400 * t) * np.sin(np.pi * t / 0.2) ** 2
    wave = np.concatenate([np.zeros(round(QUIET * RATE)), burst])
    found: dict[str, object] = {"lags": [], "errors": []}
    latency = 0
    for attempt in range(4):
        daq = opened(latency, monitor="heard" if attempt == 3 else None)
        with daq.stream(["silent", "heard"], RATE, 4800, len(wave) + 9600, {"out": wave}) as stream:
            volts = stream.capture().volts
        lag = int(np.correlate(volts[1], burst, "valid").argmax()) - round(QUIET * RATE)
        assert isinstance(found["lags"], list) and isinstance(found["errors"], list)
        found["lags"].append(lag)
        begin = round(QUIET * RATE) + lag
        found["errors"].append(float(np.abs(volts[1][begin : begin + len(burst)] - burst).max()))
        found["silent"] = float(np.abs(volts[0]).max())
        latency += lag if attempt == 0 else 0
        daq.close()
    with opened(latency).stream(["silent"], RATE, 4800, 48_000) as stream:
        found["recorded"] = stream.capture().volts.shape[1]
    found["identity"] = daq.identity
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    stop = threading.Event()
    threading.Thread(target=plug, args=(stop,), daemon=True).start()
    main()
    stop.set()
