"""`python -m haploop.console.worker`: the worker's process. Started by `haploop serve`."""

from __future__ import annotations

import argparse
import os
import secrets
import signal
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from types import FrameType

from ...base.errors import HaploopError
from ...base.marks import marked
from ...instruments import load_rig_file
from ...instruments.tape import recorded
from ..data_folder import DataFolder
from .link import Address, address_path, written
from .listener import Listener
from .worker import Worker


def main() -> int:
    """Run a worker until it is told to end. Exit codes as of every command."""
    parser = argparse.ArgumentParser(prog="haploop.console.worker")
    parser.add_argument("--rig", required=True)
    parser.add_argument("--simulate", choices=["twin", "wire"])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--calibrations", type=Path, required=True)
    parser.add_argument("--tape", type=Path)
    parser.add_argument("--virtual-time", action="store_true", help="for tests")
    options = parser.parse_args()
    try:
        file = load_rig_file(options.rig)
        data = DataFolder(options.data, options.calibrations)
        worker = Worker(file, options.simulate, data, real_time=not options.virtual_time)
        listener = Listener(worker, secrets.token_hex(32), secrets.token_hex(32))
        folders = (str(data.root), str(data.history.folder))
        address = Address(os.getpid(), listener.port, listener.token, listener.stop_token, *folders)

        def end(_number: int, _frame: FrameType | None) -> None:
            worker.end_soon()
            raise KeyboardInterrupt

        # A program that was started in the background may ignore SIGINT, and STOP is one.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, end)
        path = address_path(file, options.simulate)
        # The mark says that this worker lives, also when it hangs.
        taped = recorded(options.tape) if options.tape else nullcontext()
        with marked(path), taped, written(path, address):
            threading.Thread(target=listener.serve_forever, name="haploop-listener", daemon=True).start()
            worker.run()
            listener.shutdown()
    except HaploopError as error:
        print(f"Error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
