"""The sound card's driver on the real sounddevice and PortAudio, where JACK's dummy card can be started."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

PERIOD = 4096
"""Frames of the dummy card's period: a busy computer must call back within 85 ms."""

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("sounddevice") is None or shutil.which("jackd") is None,
    reason="needs sounddevice, PortAudio and jackd (Debian: libportaudio2 jackd2 jack-tools)",
)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[dict[str, str]]:
    """A JACK server of its own with a card that is none; yield the environment of its clients."""
    name = f"haploop-{os.getpid()}"
    quiet = {"HOME": str(tmp_path), "JACK_NO_AUDIO_RESERVATION": "1", "JACK_NO_START_SERVER": "1"}
    environment = os.environ | quiet | {"JACK_DEFAULT_SERVER": name, "XDG_RUNTIME_DIR": str(tmp_path)}
    card = ["-d", "dummy", "-r", "48000", "-p", str(PERIOD), "-C", "2", "-P", "2"]
    command = ["jackd", "--no-realtime", "-n", name, *card]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as jack:
        try:
            for _ in range(100):
                listed = subprocess.run(["jack_lsp"], env=environment, capture_output=True, check=False)
                if listed.returncode == 0 or jack.poll() is not None:
                    break
                time.sleep(0.1)
            if jack.poll() is not None:
                pytest.skip("jackd does not start here")
            yield environment
        finally:
            jack.terminate()


def test_a_play_is_recorded_sample_by_sample_once_the_latency_is_known(server):
    program = [sys.executable, str(Path(__file__).with_name("on_portaudio.py"))]
    for _ in range(3):
        ran = subprocess.run(program, env=server, capture_output=True, text=True, check=False)
        if "(an overrun)" not in ran.stderr and "(an underrun)" not in ran.stderr:
            break  # a busy computer: what the driver must say of it is said
    else:
        pytest.skip("this computer is too busy for PortAudio")
    assert ran.returncode == 0, ran.stderr[-2000:]
    found: dict[str, Any] = json.loads(ran.stdout)
    assert found["lags"] == [PERIOD, 0, 0, 0]
    assert max(found["errors"]) < 1e-6 and found["silent"] == 0
    assert found["recorded"] == 48_000
    assert found["identity"] == "system"
