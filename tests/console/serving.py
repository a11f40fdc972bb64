"""A console as its users have it: `haploop serve` in processes of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

from haploop.instruments import load_rig_file

__all__ = ["Served", "served"]


@dataclass
class Served:
    """A running server, its address, and its token."""

    process: subprocess.Popen[str]
    base: str
    token: str
    data: Path
    rig: str = "simulated"

    @property
    def url(self) -> str:
        return f"{self.base}/#{self.token}"

    def ask(self, path: str, values: object = None) -> Any:
        body = None if values is None else json.dumps(values).encode()
        request = Request(self.base + path, body, {"X-Haploop-Token": self.token})
        with urlopen(request, timeout=60) as answer:
            return json.loads(answer.read())


def start(data: Path, *options: str, state: Path) -> Served:
    data.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "haploop", "serve", "--json", "--data", str(data), *options]
    environment = {**os.environ, "HAPLOOP_STATE": str(state)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True)
    line = process.stdout.readline()
    assert line, process.wait()
    base, _, token = json.loads(line)["url"].partition("/#")
    rig = options[options.index("--rig") + 1] if "--rig" in options else "simulated"
    return Served(process, base, token, data, load_rig_file(rig).name)


def end(one: Served) -> None:
    """Ctrl-C, which ends the worker too."""
    one.process.terminate()
    one.process.wait(60)
    one.process.stdout.close()


@contextmanager
def served(data: Path, *options: str, state: Path) -> Iterator[Served]:
    found = start(data, *options, state=state)
    try:
        yield found
    finally:
        end(found)
