"""`haploop export`: a calibration for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from haploop.commands.options import JSON, PATH

__all__ = ["export"]


@click.command()
@click.argument("file", type=PATH)
@click.option(
    "--to",
    required=True,
    type=PATH,
    metavar="OUT.uff|OUT.mat",
    help="Universal File Format 58 (the response and its coherence), or MATLAB (the model).",
)
@JSON
def export(file: Path, to: Path, as_json: bool) -> int:
    """Write a calibration FILE for other programs: its response as .uff, or its model as .mat."""
    import haploop  # noqa: PLC0415
    from haploop.console import print_json, print_line  # noqa: PLC0415
    from haploop.targets import new_file  # noqa: PLC0415

    kind = to.suffix.lower()
    if kind not in (".uff", ".mat"):
        raise haploop.ConfigurationError(f"{to} is no name to export to: it must end with .uff or .mat.")
    new_file(to)
    calibration = haploop.Calibration.load(file)
    response = calibration.response
    if kind == ".uff":
        haploop.write_uff(to, [response])
        held = f"{len(response.frequencies)} lines of velocity per volt"
    else:
        calibration.model.save_mat(to, calibration.rate_hz)
        held = f"{len(calibration.model.poles)} poles, as state space and as second-order sections"
    if as_json:
        print_json({"file": str(file), "to": str(to), "holds": held, "simulated": response.simulated})
    else:
        print_line(f"{to}: {held}.")
        if response.simulated:
            print_line("Simulated: no real instrument measured this.")
    return 0
