"""Neurodata Without Borders: a recording as one session (optional: `pip install "haploop[nwb]"`)."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import h5py

from ..base.extras import optional
from ..base.files import new_file
from .views import PressTable, Signals

_UNITS = {"m/s^2": "m/s^2", "1": "n.a."}


def write_recording(signals: Signals, presses: PressTable, path: Path) -> None:
    """A TimeSeries a channel, the participant as the subject, and a trial a press."""
    pynwb = optional("pynwb", "nwb", "The format nwb")
    about = signals.about
    file = pynwb.NWBFile(
        session_description=f"{signals.title}. {about.get('note', 'Measured.')}",
        identifier=str(about["content_hash"]),
        session_start_time=datetime.fromisoformat(str(about["started"])),
        session_id=str(about.get("session") or about["source"]),
        experiment_description=str(about.get("study", "")) or "Presses of a button.",
        keywords=["haptics", "button press", str(about["button"])],
        source_script=str(about["software"]),
        source_script_file_name=str(about["source"]),
        # Sex and age are not recorded: U is unknown, and the age an open interval.
        subject=pynwb.file.Subject(
            subject_id=str(about["participant"]),
            species="Homo sapiens",
            sex="U",
            age="P0Y/",
            description="A participant under a pseudonym.",
        ),
    )
    for channel in signals.channels:
        file.add_acquisition(
            pynwb.TimeSeries(
                name=channel.name,
                data=channel.values,
                unit=_UNITS.get(channel.unit, channel.unit or "n.a."),
                rate=signals.rate_hz,
                starting_time=channel.delay,
                description=f"{channel.name.replace('_', ' ')}, {channel.unit or 'no unit'}",
            )
        )
    columns = [
        name for name in presses.units if name.startswith(("press", "attempt", "accepted", "force_at"))
    ]
    for name in columns:
        unit = presses.units[name]
        file.add_trial_column(name, f"{name.replace('_', ' ')}{f' ({unit})' if unit else ''}")
    for row in presses.rows:
        values = {name: float("nan") if row[name] is None else row[name] for name in columns}
        start, stop = row["onset_s"], row["release_s"]
        if start is not None and stop is not None:
            file.add_trial(start_time=float(start), stop_time=float(stop), **values)
    # In memory: where a disk refuses what it writes, the HDF5 library crashes as the program ends.
    with (
        h5py.File("nwb", "w", driver="core", backing_store=False) as raw,
        pynwb.NWBHDF5IO(file=raw, mode="w") as out,
    ):
        out.write(file)
        raw.flush()
        image = raw.id.get_file_image()
    with new_file(path) as part:
        part.write_bytes(image)
