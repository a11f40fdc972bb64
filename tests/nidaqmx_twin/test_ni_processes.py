"""Tasks of several processes on the cards of one: what ends with whom, and what a forked child may use."""

import os
import subprocess
import sys
import time

import nidaqmx
import pytest

from haploop.nidaqmx_twin import NiTwin
from haploop.nidaqmx_twin.threads import Threads
from tests.nidaqmx_twin.ni_client import code

_OTHER_PROGRAM = """
import nidaqmx
task = nidaqmx.Task("press")
task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
task.timing.cfg_samp_clk_timing(1000, sample_mode=nidaqmx.constants.AcquisitionType.CONTINUOUS)
task.start()
print(task.name, flush=True)
input()
"""


@pytest.mark.parametrize("late", [0.0, 2.0])
@pytest.mark.parametrize("end", ["kill", "exit"])
def test_a_task_lives_in_its_process(end, late, monkeypatch):
    """Its name is unique there (inferred), and what it has reserved is free when the process has ended,
    however (NI knowledge base kA00Z000000P8kmSAC).

    So it is where the server's thread for the first call, which lasts as long as the process, starts `late`
    (s): gRPC runs no call whose client has gone before.
    """
    first, submit = iter([late]), Threads.submit

    def submit_late(pool, call, *args):
        delay = next(first, 0.0)
        return submit(pool, lambda: (time.sleep(delay), call(*args)))

    monkeypatch.setattr(Threads, "submit", submit_late)
    with NiTwin({"Dev1": "PCIe-6363"}, time="real") as twin:
        program = subprocess.Popen(
            [sys.executable, "-c", _OTHER_PROGRAM],
            env=twin.environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        with program, nidaqmx.Task("press") as task:
            assert program.stdout.readline() == "press\n"
            task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
            assert code(task.start) == -50103
            if end == "kill":
                program.kill()
            else:
                program.stdin.write("\n")
                program.stdin.flush()
            program.wait(120)
            for _ in range(3000):
                if code(task.start) is None:
                    break
                time.sleep(0.02)
            assert isinstance(task.read(), float)


_FORKS = """
import os, sys
import nidaqmx
from nidaqmx.errors import DaqNotFoundError
from contextlib import nullcontext
from haploop.base.errors import ConfigurationError
from haploop.nidaqmx_twin import NiTwin

_, where, end = sys.argv

def counts(device):
    task = nidaqmx.Task()
    task.ai_channels.add_ai_voltage_chan(device + "/ai0")
    # A buffer of minutes: the parent does not read while it waits for its child, on a busy computer too.
    kind = nidaqmx.constants.AcquisitionType.CONTINUOUS
    task.timing.cfg_samp_clk_timing(1000, sample_mode=kind, samps_per_chan=200_000)
    task.register_every_n_samples_acquired_into_buffer_event(100, lambda *_: 0)
    task.start()
    return task

with NiTwin({"Dev1": "PCIe-6363"}) if where == "inside" else nullcontext() as twin:
    parents = counts("Dev1")
    parents.read(100)
    child = os.fork()
    if not child and end == "use":
        with counts("Dev2") as task:
            task.read(100)
    if not child and end == "refused":
        def refused(use):
            try:
                return use()
            except (nidaqmx.DaqError, DaqNotFoundError, ConfigurationError) as error:
                return str(error).split(":")[0].split("\\n")[0]
        print(refused(nidaqmx.Task), refused(lambda: parents.read(1)), refused(parents.stop),
              refused(lambda: twin.set("Dev1/ai0", 1)), sep=", ", flush=True)
    if not child and end != "_exit":
        sys.exit(0)
    if not child:
        os._exit(0)
    _, status = os.waitpid(child, 0)
    read = len(parents.read(200))
    parents.close()
print(status, read)
"""


_NO_CARDS = "A forked child has no NI cards, because they are simulated in its parent"
_NO_TASK = "Task specified is invalid or does not exist"


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.parametrize(
    ("where", "end", "told"),
    [
        ("inside", "_exit", ""),
        ("inside", "exit", ""),
        ("inside", "refused", f"{_NO_CARDS}, {_NO_TASK}, {_NO_TASK}, {_NO_CARDS}\n"),
        ("beside", "exit", ""),
        ("beside", "use", ""),
    ],
)
def test_a_forked_child_closes_no_task_of_its_parent(where, end, told):
    """Not at its end, and not by a task of its own, for which it has a connection of its own; where the cards
    are in its parent, it has none.
    """
    with NiTwin({"Dev1": "PCIe-6363", "Dev2": "PCIe-6363"}, time="real") as twin:
        program = [sys.executable, "-c", _FORKS, where, end]
        environment = twin.environment() if where == "beside" else None
        ran = subprocess.run(
            program, env=environment, capture_output=True, text=True, timeout=200, check=False
        )
    assert ran.stdout == f"{told}0 200\n", ran.stderr
