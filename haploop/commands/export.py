"""`haploop export`, `import`: exchange calibrations and responses with other programs."""

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
    help="Output file: .uff (Universal File Format 58: response and coherence) or .mat (MATLAB: model).",
)
@JSON
def export(file: Path, to: Path, as_json: bool) -> int:
    """Export the calibration FILE as .uff or .mat."""
    import haploop  # noqa: PLC0415
    from haploop.destinations import check_new_file  # noqa: PLC0415
    from haploop.progress import print_json, print_line  # noqa: PLC0415

    kind = to.suffix.lower()
    if kind not in (".uff", ".mat"):
        raise haploop.ConfigurationError(
            f"{to} has an unknown file type: use a name that ends with .uff or .mat."
        )
    check_new_file(to)
    calibration = haploop.Calibration.load(file)
    response = calibration.response
    if kind == ".uff":
        haploop.write_uff(to, [response])
        held = f"velocity per volt at {len(response.frequencies)} frequencies"
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
@click.option("--out", "-o", required=True, type=PATH, metavar="FILE.h5", help="Calibration file to write.")
@click.option("--patch", help="Patch that was driven.  [default: as the file states]")
@click.option(
    "--point", help="Measured point: button, or a grid point's number.  [default: as the file states]"
)
@RIG
@JSON
def import_(file: Path, out: Path, patch: str | None, point: str | None, rig: str, as_json: bool) -> int:
    """Make a calibration from a .uff file.

    FILE holds responses measured by another program in Universal File Format 58, for example the export of a
    scanning vibrometer. --rig names the rig that the response belongs to. --patch and --point select one of
    several responses in FILE.
    """
    import haploop  # noqa: PLC0415
    from haploop.destinations import check_new_file  # noqa: PLC0415
    from haploop.instruments import load_rig_file  # noqa: PLC0415
    from haploop.show import show  # noqa: PLC0415

    check_new_file(out)
    found = haploop.read_uff(file, rig=load_rig_file(rig))
    wanted = [r for r in found if patch in (None, r.patch) and point in (None, r.point)]
    if len(found) == 1 and not wanted:
        wanted = list(haploop.read_uff(file, rig=load_rig_file(rig), patch=patch, point=point))
    if len(wanted) != 1:
        places = ", ".join(f"{r.patch} at {r.point}" for r in found)
        raise haploop.ConfigurationError(
            f"{file} holds {len(wanted) or 'no'} matching responses (it has {places}): "
            "select one with --patch and --point."
        )
    haploop.Calibration.of(wanted[0]).save(out)
    show.show(out, as_json)
    return 0
