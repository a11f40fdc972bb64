"""`haploop export`, `import`: calibrations for other programs, and responses from them."""

from __future__ import annotations

from pathlib import Path

import click

from haploop.commands.options import JSON, PATH, RIG

__all__ = ["export", "import_"]


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


@click.command("import")
@click.argument("file", type=PATH, metavar="FILE.uff")
@click.option("--out", "-o", required=True, type=PATH, metavar="FILE.h5", help="The calibration to write.")
@click.option("--patch", help="The patch that was driven.  [default: as the file says]")
@click.option("--point", help="Where it was measured: button, or a grid point.  [default: as the file says]")
@RIG
@JSON
def import_(file: Path, out: Path, patch: str | None, point: str | None, rig: str, as_json: bool) -> int:
    """Make a calibration of a response that another program measured (Universal File Format 58).

    A scanning vibrometer's export, for example. --rig says which rig it is to be played on; of several
    responses in FILE, --patch and --point choose one.
    """
    import haploop  # noqa: PLC0415
    from haploop import show  # noqa: PLC0415
    from haploop.targets import new_file  # noqa: PLC0415
    from instruments import load_rig_file  # noqa: PLC0415

    new_file(out)
    found = haploop.read_uff(file, rig=load_rig_file(rig))
    wanted = [r for r in found if patch in (None, r.patch) and point in (None, r.point)]
    if len(found) == 1 and not wanted:
        wanted = list(haploop.read_uff(file, rig=load_rig_file(rig), patch=patch, point=point))
    if len(wanted) != 1:
        places = ", ".join(f"{r.patch} at {r.point}" for r in found)
        raise haploop.ConfigurationError(
            f"{file} holds {len(wanted) or 'no'} such responses (it has {places}): "
            "choose one by --patch and --point."
        )
    haploop.Calibration.of(wanted[0]).save(out)
    show.show(out, as_json)
    return 0
