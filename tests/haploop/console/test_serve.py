"""`haploop serve` as processes: the server may be killed and come back, and the recording goes on."""

from __future__ import annotations

import os
import time
from urllib.error import HTTPError

import pytest

from haploop.acquisition import Recording
from haploop.console.worker import Address
from tests.haploop.console.serving import end, start


def test_a_server_that_is_killed_and_comes_back_finds_the_recording_going_on(tmp_path):
    state, data = tmp_path / "state", tmp_path / "data"
    first = start(data, "--port", "0", state=state)
    again = None
    try:
        first.ask("/api/command/override", {"reason": "a test"})
        wanted = {"button": "push", "participant": "P01", "presses": 3}
        first.ask("/api/command/start", {"kind": "record", "parameters": wanted})
        address = next(iter((state / "simulated").glob("console-*.json")))
        worker = Address.read(address)
        assert worker is not None
        if os.name != "nt":
            assert address.stat().st_mode & 0o077 == 0, "the tokens are its owner's"
        path = data / "recordings" / "P01-push.h5"
        while not path.exists():
            time.sleep(0.05)
        first.process.kill()
        first.process.wait()
        again = start(data, "--port", "0", state=state)
        assert Address.read(address) == worker, "the same worker, which nobody has disturbed"
        assert again.token != first.token
        with pytest.raises(HTTPError, match="403"):
            again.__class__(again.process, again.base, first.token, data).ask("/api/files")
        until = time.monotonic() + 60
        while not (path.exists() and Recording.open(path).complete):
            assert time.monotonic() < until
            time.sleep(0.2)
        assert again.ask(f"/api/presses?file=recordings/{path.name}")["state"] == "finished"
    finally:
        assert first.process.stdout is not None
        first.process.stdout.close()
        end(again or first)
    recording = Recording.open(path)
    assert len(recording.accepted) == 3 and recording.content_hash
    assert recording.blocks["first"][-1] + recording.blocks["count"][-1] == recording.volts.shape[1]
    assert not address.exists(), "Ctrl-C ended the worker too"
