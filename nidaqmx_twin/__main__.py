"""Run a program on simulated NI cards, or serve them to others, in real time."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..base.errors import ConfigurationError, HaploopError


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m {__package__}",
        usage="%(prog)s [options] [-- COMMAND ...]",
        description="Run a program whose nidaqmx finds simulated NI cards, and exit as it does. Without a "
        "COMMAND, serve the cards by NI's gRPC service until Ctrl-C.",
    )
    parser.add_argument(
        "--device", action="append", default=[], metavar="NAME=PRODUCT", help="a card: Dev1=PCIe-6363"
    )
    parser.add_argument("--devices", type=Path, metavar="FILE.ini", help="cards of an NI MAX text export")
    parser.add_argument("--bench", type=Path, metavar="FILE.toml", help="cards, inputs, wires and failures")
    parser.add_argument("--port", type=_port, default=0, help="TCP port; 0, the default, for a free one")
    parser.add_argument("--products", action="store_true", help="list the products that can be simulated")
    return parser


def _port(text: str) -> int:
    """A TCP port. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is no TCP port: give a number from 0 to 65535")
    return int(text)


def _run(asked: argparse.Namespace, command: Sequence[str]) -> int:
    # Not before what is asked for is read: this takes a second.
    from .bench import cards, devices_of, read_bench  # noqa: PLC0415
    from .standalone import run_command, serve  # noqa: PLC0415

    bench = read_bench(asked.bench) if asked.bench is not None else None
    devices = devices_of(asked.device, asked.devices, bench)
    if not devices:
        raise ConfigurationError(
            "Name a card: by --device NAME=PRODUCT, --devices FILE.ini or --bench FILE.toml."
        )
    if bench is not None and bench.instruments:
        raise ConfigurationError(f"{asked.bench}: [instruments] are served by haploop only, not here.")
    with cards(devices, bench, port=asked.port) as twin:
        assert twin is not None
        for sentence in twin.left_out:
            print(sentence, file=sys.stderr, flush=True)
        if command:
            return run_command(command, twin.environment())
        serve(twin.port, twin.unserved)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Return the exit code: that of the command; 2 for what is asked for in vain, 3 for a port in use."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    split = given.index("--") if "--" in given else len(given)
    asked = _parser().parse_args(given[:split])
    try:
        if asked.products:
            from .products import described  # noqa: PLC0415

            print("\n".join(described({})))
            return 0
        return _run(asked, given[split + 1 :])
    except KeyboardInterrupt:
        return 130
    except HaploopError as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, ConfigurationError) else 3


if __name__ == "__main__":
    raise SystemExit(main())
