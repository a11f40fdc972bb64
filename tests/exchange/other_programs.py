"""Files as other programs write them, for tests that vary what those say."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def function58(
    name: str, x: np.ndarray, data: np.ndarray, kind: int, unit: str, **more: Any
) -> dict[str, Any]:
    """A time signal as data set 58 of a universal file: kind is 12 for acceleration, 13 for force."""
    return {
        "type": 58, "binary": 0, "func_type": 1, "id1": name, "rsp_node": 1, "rsp_dir": 3, "ref_node": 0,
        "ref_dir": 0, "abscissa_spacing": 1, "abscissa_spec_data_type": 17, "abscissa_axis_units_lab": "s",
        "ordinate_spec_data_type": kind, "ordinate_axis_units_lab": unit, "orddenom_spec_data_type": 0,
        "x": x, "data": data,
    } | more  # fmt: skip


def write_xdf(path: Path, rate: int, signals: dict[str, tuple[str, np.ndarray]], begun: str = "") -> None:
    """By the specification of XDF 1.0: a header, a stream's header, its samples from 10 s on and its footer.

    `signals` are unit and values by name; `begun` dates the file's header, as LabRecorder does.
    """
    pytest.importorskip("pyxdf")
    channels = "".join(
        f"<channel><label>{name}</label><unit>{unit}</unit></channel>" for name, (unit, _) in signals.items()
    )
    rows = np.stack([values for _, values in signals.values()], axis=1)
    count, number = rows.shape
    about = (
        f"<info><name>lab</name><type>Haptics</type><channel_count>{number}</channel_count>"
        f"<nominal_srate>{rate}</nominal_srate><channel_format>double64</channel_format><source_id>a</source_id>"
        f"<desc><channels>{channels}</channels></desc></info>"
    )
    samples = b"".join(struct.pack("<Bd", 8, 10 + n / rate) + row.tobytes() for n, row in enumerate(rows))
    date = f"<datetime>{begun}</datetime>" if begun else ""
    stream = struct.pack("<I", 1)
    chunks = (
        (1, f"<info><version>1.0</version>{date}</info>".encode()),
        (2, stream + about.encode()),
        (3, stream + struct.pack("<BI", 4, count) + samples),
        (6, stream + f"<info><sample_count>{count}</sample_count></info>".encode()),
    )
    with path.open("wb") as file:
        file.write(b"XDF:")
        for tag, content in chunks:
            file.write(struct.pack("<BIH", 4, len(content) + 2, tag) + content)
