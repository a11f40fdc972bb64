"""Files whose channels say for themselves what they are: TDMS, XDF, Parquet and netCDF of the classic format.

Runs in `contained`'s process.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.entry_points import optional
from .hdf5_tree import CF, unpacked
from .start_times import Start, instant, since_of, zone_in
from .table import Column
from .units import doubt_beside, split_heading

_SCALES = (
    "Linear", "Polynomial", "Table", "Thermocouple", "Thermistor", "RTD", "Strain", "Add", "Subtract",
    "AdvancedAPI",
)  # fmt: skip
"""Of DAQmx, those that the library for TDMS applies."""
_SECOND = np.timedelta64(1, "s")
_JITTER = 5e-3
"""Most that a piece's start may be off (s): programs that write as they read take the system's clock."""
_LEAD = 28
"""Bytes before a TDMS segment's metadata; the last eight are the metadata's length."""


def tdms(path: Path, left: list[str]) -> Iterator[Column]:
    """Channels with rate, start and unit as LabVIEW's waveforms state them; names of others go to `left`.

    Raises ValueError for spectra, and for pieces that do not adjoin.
    """
    nptdms = optional("nptdms", "files", "A TDMS file")
    # Opened here: by its name the library would trust an index file beside it, which may be of an older one.
    with path.open("rb") as opened, nptdms.TdmsFile.open(opened) as file:
        channels = [channel for group in file.groups() for channel in group.channels() if len(channel)]
        several = len({channel.group_name for channel in channels}) > 1
        first = _of_first_segment(nptdms, path)
        starts = {one.path: _begun({**one.properties, **first.get(one.path, {})}) for one in channels}
        origin = min((at for at in starts.values() if at is not None), default=None)
        for channel in channels:
            said = {**file.properties, **file[channel.group_name].properties, **channel.properties}
            values = np.asarray(channel[:])
            if values.dtype.kind not in "iufbM":
                left.append(str(channel.name))
                continue
            if (
                str(said.get("wf_xname", "")).lower().startswith("freq")
                or said.get("wf_xunit_string") == "Hz"
            ):
                raise ValueError(f"{channel.name} is over frequency")
            step = float(said.get("wf_increment", 0.0))
            own = channel.properties
            at, last = starts[channel.path], _begun(own)
            if step > 0 and at is not None and last is not None and at != last:
                _refuse_gap(channel, float((last - at) / _SECOND) / step, step)
            start, since = None, at
            if step > 0 and (origin is None or at is not None):
                later = 0.0 if origin is None or at is None else float((at - origin) / _SECOND)
                start, since = later + float(own.get("wf_start_offset", 0.0)), origin
            unit = next((str(said[k]) for k in ("unit_string", "NI_UnitDescription") if said.get(k)), "")
            # Scales that the library knows are applied; of an unknown one it gives the counts.
            own_doubt = doubt_beside({key: said[key] for key in said if not key.startswith("NI_")})
            for key, value in said.items() if said.get("NI_Scaling_Status") != "scaled" else ():
                if key.endswith("_Scale_Type") and value not in _SCALES:
                    own_doubt = f"its scale ({key} = {value}) was not applied"
            name, stamps = str(channel.name), values.dtype.kind == "M"
            yield Column(
                f"{channel.group_name}.{name}" if several else name,
                unit,
                (values - _first(values)) / _SECOND if stamps else values.astype(np.float64),
                float(f"{1 / step:.9g}") if step > 0 else None,
                stamps,
                start,
                _utc("", _first(values)) if stamps else _utc("wf_start_time ", since),
                doubt=own_doubt,
            )


def _first(instants: Any) -> Any:
    """The first of some instants that is there, or none (NaT)."""
    return instants[np.argmin(np.isnat(instants))]


def _of_first_segment(nptdms: Any, path: Path) -> dict[str, Any]:
    """By a channel's path, its properties as the first segment states them.

    The library gives the last ones: of a waveform that was written piece by piece, the last piece's start.
    """
    with path.open("rb") as file:
        lead = file.read(_LEAD)
        size = _LEAD + int.from_bytes(lead[-8:], "little")
        if len(lead) < _LEAD or size > path.stat().st_size:
            return {}
        head = io.BytesIO(lead + file.read(size - _LEAD))
    found = nptdms.TdmsFile.read_metadata(head)
    return {one.path: one.properties for group in found.groups() for one in group.channels()}


def _refuse_gap(channel: Any, begun: float, step: float) -> None:
    """Raise ValueError where the last piece of a waveform, which begins at a sample, lies at another one."""
    lies = min((int(piece.offset) for piece in channel.data_chunks()), key=lambda at: abs(at - begun))
    if abs(begun - lies) > max(2, _JITTER / step):
        raise ValueError(
            f"{channel.name} was written in pieces that do not adjoin: by its wf_start_time the last one "
            f"begins at {begun * step:.6g} s, and the samples before it end at {lies * step:.6g} s"
        )


def _begun(own: Any) -> Any:
    """The instant at which a waveform begins; None for LabVIEW's zero, of one that states none."""
    at = None if own.get("wf_start_time") is None else np.datetime64(own["wf_start_time"])
    return None if at is None or at < np.datetime64("1905-01-01") else at


def _utc(words: str, at: Any) -> Start | None:
    """An instant of a format whose time is in UTC."""
    found = None if at is None else instant(f"{np.datetime64(at, 'us')}Z")
    return found and replace(found, words=f"{words}{found.words}")


def xdf(path: Path) -> tuple[list[Column], str]:
    """Channels of each stream of numbers, with the instants that the recorder corrected by its clocks.

    Beside them the date that the recorder gave the file; "" without one.
    """
    pyxdf = optional("pyxdf", "files", "An XDF file")
    streams, header = pyxdf.load_xdf(str(path), verbose=False)
    dated = ((header or {}).get("info", {}).get("datetime") or [""])[0]
    return list(_streams(streams)), str(dated or "")


def _streams(streams: Any) -> Iterator[Column]:
    streams = [
        one for one in streams if isinstance(one["time_series"], np.ndarray) and len(one["time_stamps"]) > 1
    ]
    for stream in streams:
        info = stream["info"]
        labels = _labels(info)
        rows = np.asarray(stream["time_series"], dtype=np.float64)
        rate = float(info["nominal_srate"][0])
        times = np.asarray(stream["time_stamps"], dtype=np.float64)
        steady = rate > 0 and abs((len(times) - 1) / (times[-1] - times[0]) / rate - 1) < 1e-3
        for number, values in enumerate(rows.T):
            name, unit = labels[number] if number < len(labels) else ("", "")
            stated = (
                f"{info['name'][0]} {name or number}" if len(streams) > 1 else name or f"channel {number + 1}"
            )
            kept = np.ascontiguousarray(values)
            if steady:
                yield Column(stated, unit, kept, rate, start_s=float(times[0]))
            else:
                yield Column(stated, unit, kept, times=times)


def _labels(info: Any) -> list[tuple[str, str]]:
    """Label and unit of a stream's channels; none where it does not describe them."""
    try:
        found = info["desc"][0]["channels"][0]["channel"]
    except (KeyError, IndexError, TypeError):
        return []
    texts = [tuple((one.get(key) or [""])[0] or "" for key in ("label", "unit")) for one in found]
    return [(label, "" if unit == "none" else unit) for label, unit in texts]


def parquet(path: Path) -> tuple[list[Column], dict[str, Any], dict[str, Any]]:
    """Columns of numbers and instants, with the unit in a field's metadata or heading, or in `attrs["units"]`
    of the table of pandas; these `attrs`; and columns of text.
    """
    arrow = optional("pyarrow.parquet", "parquet", "A Parquet file")
    table = arrow.ParquetFile(path).read(use_threads=False)
    about = json.loads((table.schema.metadata or {}).get(b"pandas", b"{}")).get("attributes", {})
    units = about.get("units")
    columns, texts = [], {}
    for field, chunks in zip(table.schema, table.columns, strict=True):
        # A number that NumPy has not, and True and False beside missing values, would be objects.
        is_number = str(field.type) == "bool" or str(field.type).startswith("decimal")
        values = (chunks.cast("float64") if is_number else chunks).to_numpy()
        said = {key.decode(): value.decode(errors="replace") for key, value in (field.metadata or {}).items()}
        unit = said.get("unit", said.get("units", ""))
        if not unit and isinstance(units, dict):
            unit = str(units.get(field.name, ""))
        name, unit = (field.name, unit) if unit else split_heading(field.name)
        if values.dtype.kind in "mM":
            first = _first(values)
            since = _utc("", first) if values.dtype.kind == "M" else None
            if since is not None and since.at is not None and getattr(field.type, "tz", None) is None:
                at = since.at.replace(tzinfo=zone_in(field.name))
                since = Start(since.words.removesuffix("Z"), at)
            columns.append(Column(name, "", (values - first) / _SECOND, stamps=True, since=since))
        elif values.dtype.kind in "iufb":
            columns.append(
                Column(name, unit, values.astype(np.float64), also=(field.name,), doubt=doubt_beside(said))
            )
        else:  # lists, say, are told as text that is left out
            texts[field.name] = np.array(["" if one is None else str(one) for one in values], dtype=object)
    return columns, about, texts


def netcdf(path: Path) -> tuple[list[Column], dict[str, Any], dict[str, Any]]:
    """Variables over the longest dimension, unpacked as CF says, and the file's own attributes.

    Beside these its columns of text; of a file over frequency its arrays too, in place of the variables.
    """
    import scipy  # noqa: PLC0415 - a second

    columns: list[Column] = []
    beside: dict[str, Any] = {}
    with scipy.io.netcdf_file(path, "r", mmap=False, maskandscale=False) as opened:
        file: Any = opened  # its attributes are known to it alone
        lengths = [one.shape[0] for one in file.variables.values() if len(one.shape) == 1]
        over_frequency = "frequency" in file.variables
        for name, variable in file.variables.items():
            said = {key: _text(value) for key, value in variable._attributes.items()}
            values = np.asarray(variable[:] if variable.shape else variable.getValue())
            if values.dtype.kind == "S":
                if values.ndim == 2:
                    beside[name] = [b"".join(row).decode(errors="replace") for row in values]
            elif over_frequency:
                beside[name] = values.astype(np.float64)
                beside[f"{name}.units"] = said.get("units", "")
            elif values.dtype.kind in "iuf" and values.ndim in (1, 2) and max(lengths) in values.shape:
                raw = np.asarray(
                    unpacked(values.astype(values.dtype.newbyteorder("=")), said), dtype=np.float64
                )
                unit, since = since_of(str(said.get("units", "")), str(said.get("calendar", "")))
                doubt = doubt_beside({key: said[key] for key in said if key not in CF})
                rows = np.atleast_2d(raw if len(raw) != max(lengths) else raw.T)
                for heading, row in zip(_headings(file, name, len(rows)), rows, strict=True):
                    columns.append(Column(heading, unit, row, since=since, doubt=doubt))
        about = {key: _text(value) for key, value in file._attributes.items()}
    return columns, about, beside


def _headings(file: Any, name: str, count: int) -> list[str]:
    """Names of a variable's columns: of a matrix, with the texts along its other dimension, or numbers."""
    if count == 1:
        return [name]
    for dimension in file.variables[name].dimensions:
        along = file.variables.get(dimension)
        if along is not None and along[:].dtype.kind == "S" and len(along[:]) == count:
            return [f"{name} {b''.join(np.atleast_1d(row)).decode(errors='replace')}" for row in along[:]]
    return [f"{name} {number}" for number in range(1, count + 1)]


def _text(value: Any) -> Any:
    return value.decode(errors="replace").strip() if isinstance(value, bytes) else value
