"""Responses as Universal File Format, data set 58: what vibrometers and modal software exchange.

A file holds one function for each response (type 4, velocity over volts) and one for its coherence (type
6), after data sets 151 (header) and 164 (SI units), which some programs want. Frequencies are listed one
by one, because excited lines need not be evenly spaced, with the seven digits that the format has room for.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pyuff

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import DataError
from ...base.files import new_file, os_error_text
from .response import Response
from .uff_units import ACCELERATION, LENGTH, VELOCITY, VOLTAGE, response_of

if TYPE_CHECKING:
    from ...instruments import RigFile

_FRF, _COHERENCE = 4, 6
_FREQUENCY, _GENERAL, _UNKNOWN = 18, 1, 0
POWERS = {LENGTH: 1, VELOCITY: 0, ACCELERATION: -1}
"""Power of 2 pi i f, from displacement, velocity or acceleration to velocity."""
_Z = (0, 3, -3)
"""Directions of a response out of the plane; 0 is a scalar."""
_MARK = "haploop: patch, point, rig as below"
_SIMULATED = "Simulated: no real instrument measured this."
_PADDED = re.compile(rb"^([ \t]*[-+\d][-+\d.eEdD \t]*?)[ \t]+(?=\r?$)", re.MULTILINE)
_HEADER, _PAIR = 12, 33
"""Lines from a data set's number to its values; columns of an abscissa and a real value."""
_WIDTH, _NAME = 80, 10
"""Characters of a line of text, and of an entity's name."""
_SURE = 0.999999
"""Coherences nearer to one are not told from it in most files."""


def write_uff(path: str | Path, responses: Sequence[Response]) -> None:
    """Write a new ASCII file of velocity responses and their coherences, whole or not at all.

    Raises DataError when it exists or cannot be written, or there is no response.
    """
    if not responses:
        raise DataError("There is no response to write.")
    functions = []
    for response in responses:
        functions.append(_function(response, _FRF, response.velocity))
        if len(response.coherence):
            functions.append(_function(response, _COHERENCE, response.coherence))
    write_uff_sets(path, functions)


def write_uff_sets(path: str | Path, functions: Sequence[dict[str, Any]]) -> None:
    """Write a new file of functions as pyuff takes them (data set 58), after data sets 151 and 164.

    Raises DataError when it exists or cannot be written.
    """
    now = datetime.now(UTC)
    software = f"haploop {metadata.version('haploop')}"
    sets: list[dict[str, Any]] = [
        pyuff.prepare_151(
            model_name="haploop",
            description="measured on a rig of haploop",
            db_app=software,
            program=software,
            date_db_created=now.strftime("%d-%b-%y"),
            time_db_created=now.strftime("%H:%M:%S"),
            version_db1=0,
            version_db2=0,
            file_type=0,
            date_db_saved=now.strftime("%d-%b-%y"),
            time_db_saved=now.strftime("%H:%M:%S"),
            date_db_written=now.strftime("%d-%b-%y"),
            time_db_written=now.strftime("%H:%M:%S"),
        ),
        pyuff.prepare_164(
            units_code=1,
            units_description="SI",
            temp_mode=1,
            length=1.0,
            force=1.0,
            temp=1.0,
            temp_offset=273.15,
        ),
    ]
    sets += functions
    with new_file(path) as part:
        try:
            pyuff.UFF(str(part)).write_sets(sets, mode="overwrite")
            _finer_abscissae(part, functions)
        except Exception as error:  # pyuff turns the disk's error into a bare Exception
            raise DataError(f"{path} cannot be written: {_disk_error(error)}.") from error


def _finer_abscissae(path: Path, functions: Sequence[Mapping[str, Any]]) -> None:
    """Give listed abscissae the seventh digit that their 13 columns hold: pyuff writes six."""
    lines = path.read_text(encoding="utf-8").splitlines()
    starts = [number + _HEADER for number, line in enumerate(lines) if line.strip() == "58"]
    for start, function in zip(starts, functions, strict=True):
        if function["abscissa_spacing"]:
            continue
        each = 1 if np.iscomplexobj(function["data"]) else 2
        for number, x in enumerate(np.asarray(function["x"], dtype=np.float64)):
            row, place = start + number // each, _PAIR * (number % each)
            lines[row] = f"{lines[row][:place]}{x:13.6e}{lines[row][place + 13 :]}"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _disk_error(error: BaseException) -> str:
    """The operating system's message, of the error or of what it was raised from or during."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError):
            return os_error_text(cause)
        cause = cause.__cause__ or cause.__context__
    return f"{type(error).__name__}: {error}"


def read_uff(
    path: str | Path, *, rig: RigFile | None = None, patch: str | None = None, point: str | None = None
) -> tuple[Response, ...]:
    """The responses in a file, in its own order: displacement, velocity or acceleration per volt.

    Nodes become points and reference nodes patches, unless haploop wrote the file or `patch` and
    `point` say otherwise. Coherences are matched by node and reference; without one, `coherence` and
    `deviation` are empty. `rig` is the rig that the responses are to be used on. What was not exported is
    empty, its level is given as 1 V, and volts commanded are taken for volts at the patch.

    Raises DataError, one sentence, for a file that is missing, damaged, or holds no such response.
    """
    path = Path(path)
    sets, content = read_uff_sets(path), path.read_bytes()
    units = units_of(path, sets)
    functions = [s for s in sets if s.get("type") == 58]
    coherences = {_place(s): s for s in functions if s["func_type"] == _COHERENCE}
    source = f"imported from {path.name}, sha256 {hashlib.sha256(content).hexdigest()}"
    responses = [s for s in functions if s["func_type"] == _FRF and int(s["rsp_dir"]) in _Z]
    if not responses:
        kinds = sorted({int(s["func_type"]) for s in functions})
        raise DataError(
            f"{path} holds no frequency response out of the plane (data set 58, type 4, direction z); "
            + (f"its functions have the types {kinds}." if kinds else "it has no data set 58 at all.")
        )
    found = (_response(path, s, coherences.get(_place(s)), units) for s in responses)
    return tuple(
        replace(
            one,
            source=source,
            rig=rig.name if rig else one.rig,
            rig_file=rig.model_dump_json() if rig else "",
            patch=patch or one.patch,
            point=point or one.point,
        )
        for one in found
    )


def _function(response: Response, kind: int, values: ComplexArray | FloatArray) -> dict[str, Any]:
    is_frf = kind == _FRF
    label = _SIMULATED if response.simulated else "Measured."
    number = int(response.point) + 1 if response.point.isdecimal() else 0
    made: dict[str, Any] = pyuff.prepare_58(
        binary=0,
        func_type=kind,
        id1=_MARK,
        id2=response.excitation[:_WIDTH],
        id3=response.created[:_WIDTH],
        id4=response.rig[:_WIDTH],
        id5=label,
        rsp_ent_name=response.point[:_NAME],
        rsp_node=number,
        rsp_dir=3,
        ref_ent_name=response.patch[:_NAME],
        ref_node=_letter(response.patch),
        ref_dir=0,
        abscissa_spacing=0,
        abscissa_spec_data_type=_FREQUENCY,
        abscissa_axis_units_lab="Hz",
        ordinate_spec_data_type=11 if is_frf else _UNKNOWN,
        ordinate_axis_units_lab="m/s" if is_frf else "1",
        # pyuff does not write the set without this one.
        orddenom_spec_data_type=_GENERAL if is_frf else _UNKNOWN,
        orddenom_axis_units_lab="V" if is_frf else "NONE",
        z_axis_axis_units_lab="NONE",
        data=np.asarray(values),
        x=np.asarray(response.frequencies, dtype=np.float64),
    )
    return made


def _letter(patch: str) -> int:
    """A patch's number: A is 1."""
    return ord(patch.upper()) - ord("A") + 1 if len(patch) == 1 and patch.isalpha() else 0


def read_uff_sets(path: str | Path) -> list[dict[str, Any]]:
    """Functions and units (data sets 58 and 164) of a file, as pyuff gives them. Raises DataError."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    try:
        with _unpadded(Path(path), content) as plain:
            file = pyuff.UFF(str(plain))
            kinds = file.get_set_types()
            # Sets that pyuff does not know, geometry say, are nobody's business here.
            found = [file.read_sets(n) for n, kind in enumerate(kinds) if kind in (58, 164)]
        return [_cut(one) for one in found]
    except MemoryError:
        raise
    except Exception as error:  # pyuff raises plain Exception, whatever is wrong
        raise DataError(f"{path} is damaged or no Universal File Format: it cannot be read.") from error


@contextmanager
def _unpadded(path: Path, content: bytes) -> Iterator[Path]:
    """The file, or a copy of which no line of numbers ends in blanks: pyuff takes these for numbers."""
    if b"58b" in content or not _PADDED.search(content):
        yield path
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "copy.uff"
        copy.write_bytes(_PADDED.sub(rb"\1", content))
        yield copy


def _cut(one: dict[str, Any]) -> dict[str, Any]:
    """A function without what fills its last line up: its number of points rules."""
    if one["type"] == 58 and one.get("data") is not None:
        count = int(one["num_pts"])
        if len(one["data"]) < count:
            raise ValueError("points")
        one["x"], one["data"] = one["x"][:count], one["data"][:count]
    return one


def units_of(path: str | Path, sets: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Data set 164 of a file; None without one. Raises DataError for several that differ."""
    found = [one for one in sets if one.get("type") == 164]
    if len({(one["length"], one["force"]) for one in found}) > 1:
        raise DataError(f"{path} has several data sets 164 of different units: export one measurement.")
    return found[0] if found else None


def _place(function: Mapping[str, Any]) -> tuple[str, int, int, str, int]:
    return (
        str(function["rsp_ent_name"]).strip(),
        int(function["rsp_node"]),
        int(function["rsp_dir"]),
        str(function["ref_ent_name"]).strip(),
        int(function["ref_node"]),
    )


def _response(
    path: Path,
    function: Mapping[str, Any],
    coherence: Mapping[str, Any] | None,
    units: Mapping[str, Any] | None,
) -> Response:
    """The response as the file states it, without its source and rig."""
    f, H = np.asarray(function["x"], dtype=np.float64), np.asarray(function["data"], dtype=np.complex128)
    good = len(f) == len(H) and np.all(np.isfinite(f)) and np.all(np.isfinite(H)) and np.all(np.diff(f) > 0)
    if not good or len(f) != int(function["num_pts"]) or len(f) < 2:
        raise DataError(
            f"{path} is damaged: the response of node {function['rsp_node']} has not the rising frequencies "
            f"and the {function['num_pts']} numbers that it announces."
        )
    velocity = _velocity(path, function, f, H, units)
    kept = f > 0
    f, velocity = f[kept], velocity[kept]
    name, node, _, reference, reference_node = _place(function)
    ours = str(function["id1"]).startswith(_MARK)
    share = np.zeros(0)
    if coherence is not None and len(coherence["x"]) == len(kept) and np.allclose(coherence["x"][kept], f):
        share = np.clip(np.real(np.asarray(coherence["data"]))[kept], 0.0, 1.0)
    return plain_response(
        reference if ours else str(reference_node),
        name if ours else str(node),
        f,
        velocity,
        share,
        excitation=str(function["id2"]).strip(),
        rig=str(function["id4"]).strip(),
        simulated=ours and str(function["id5"]).startswith(_SIMULATED[:9]),
        created=str(function["id3"]).strip(),
    )


def plain_response(
    patch: str,
    point: str,
    f: FloatArray,
    velocity: ComplexArray,
    coherence: FloatArray,
    *,
    excitation: str = "",
    rig: str = "",
    simulated: bool = False,
    created: str = "",
) -> Response:
    """A response of another program: (lines,) each, in Hz, m/s per V and 1; `coherence` may be empty."""
    # Random error of one average (Bendat and Piersol, Random Data, 2010, section 9.2); how many there
    # were is not in the file, so that this is an upper bound.
    sure = np.clip(coherence, 1e-6, _SURE)
    deviation = np.abs(velocity) * np.sqrt((1 - sure) / sure) if len(coherence) else np.zeros(0)
    return Response(
        patch=patch,
        point=point,
        frequencies=f,
        velocity=velocity,
        deviation=deviation,
        coherence=coherence,
        path=np.ones(len(f), dtype=np.complex128),
        noise=np.zeros(0),
        distortion=np.zeros((0, 0)),
        repeats=1,
        level=1.0,
        levels=np.zeros(0),
        level_gain=np.zeros(0, dtype=np.complex128),
        pickup_range=np.inf,
        excitation=excitation,
        source="",
        rig=rig,
        rig_file="",
        simulated=simulated,
        created=created,
    )


def _velocity(
    path: Path, function: Mapping[str, Any], f: FloatArray, H: ComplexArray, units: Mapping[str, Any] | None
) -> ComplexArray:
    """M/s per V, whatever the function's ordinate is. Raises DataError when that cannot be told."""
    above, below = response_of(function, units)
    what = f"{path}: the response of node {function['rsp_node']}"
    for one, side in ((above, "what moved"), (below, "its reference")):
        if one.doubt:
            raise DataError(
                f"{what} does not tell the unit of {side}: {one.doubt}. Export it with its units."
            )
    if above.si not in POWERS:
        raise DataError(f"{what} is in {above.label!r}; displacement, velocity or acceleration is needed.")
    if below.si != VOLTAGE:
        raise DataError(
            f"{what} is per {below.label or below.si}, and a patch is driven by volts: export it with the "
            "drive voltage as reference."
        )
    sign = -1.0 if int(function["rsp_dir"]) < 0 else 1.0
    return np.asarray(sign * above.factor / below.factor * H * (2j * np.pi * f) ** POWERS[above.si])
