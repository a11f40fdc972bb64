"""`haploop export`: files for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from ...commands import public as haploop
from ...commands.options import JSON, PATH
from ...terminal.progress import SIMULATED, print_either


class _Format(click.Choice[str]):
    """A format; of a picture, which command writes it."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """See `click.Choice.convert`. Raises ConfigurationError for a picture."""
        if value in ("svg", "pdf", "png"):
            raise haploop.ConfigurationError(
                "Figures, as SVG, PDF and CSV of what each draws, are written by another command: haploop "
                "figures FILE --out DIR."
            )
        return super().convert(value, param, ctx)


_FORMATS = ("csv", "wav", "wav48", "mat", "uff", "xdf", "ahap", "haptic", "android", "hjif")


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--to", "format", required=True, type=_Format(_FORMATS), help="Format, see above.", metavar="FORMAT"
)
@click.option("--out", "-o", required=True, type=PATH, metavar="PATH", help="File to write.")
@click.option(
    "--of",
    type=click.Choice(("table", "press")),
    default="table",
    show_default=True,
    help="Of a digital button, for a phone: what the table plays, or the press that was recorded.",
)
@JSON
def export(
    files: Sequence[Path], format: str, out: Path, of: Literal["table", "press"], as_json: bool
) -> int:
    """Export FILE for other programs.

    FILE is a recording, a representative press, a drive, a check, a calibration, a digital button, a
    curve, the folder of a vibration map, or a study (its study.toml or its folder). A study, or several
    recordings, become a table with one row a press.

    \b
    csv                        all
    mat, uff                   all but a study and a curve
    wav, wav48                 signals; wav48: for a sound card, at 48 kHz
    xdf                        a recording, with its LSL streams on its time
    ahap, haptic, android, hjif
                               phones and headsets: envelope and frequency
                               of a press, a drive, a check or a button

    A file of a format without units gets a sidecar, PATH.json. Figures of FILE, and their data, are
    written by `haploop figures`.
    """  # noqa: D301 - click's mark must be the character itself
    done = haploop.export_file(files, format, out, of=of)
    written = [str(file) for file in done.files]
    values = {"kind": done.kind, "to": done.format, "files": written, "simulated": done.simulated}
    said = f"{' and '.join(written)}: {done.kind} as {done.format}."
    print_either(as_json, values, said, *([SIMULATED] if done.simulated else []))
    return 0
