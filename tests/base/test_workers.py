"""Processes of a pool end with the program that made it, however it ends."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

POOL = """
import os, time
from haploop.base.workers import worker_pool

def endless(_number):
    print(os.getpid(), flush=True)
    while True:
        sum(range(10_000))

if __name__ == "__main__":
    with worker_pool(2) as pool:
        list(pool.map(endless, range(4)))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_workers_end_when_their_program_is_killed(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(POOL, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as program:
        workers = [int(program.stdout.readline()) for _ in range(2)]
        program.kill()
    until = time.monotonic() + 60
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < until
        time.sleep(0.1)
