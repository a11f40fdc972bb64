"""The readers of HDF5 that docs/reference/format.md names, on every kind of haploop's own files."""

import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

KINDS = ("recording", "representative", "drive", "check", "calibration", "button")


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Datasets of numbers, by name, as the HDF5 library reads them."""
    found: dict[str, np.ndarray] = {}

    def take(name: str, one: h5py.Dataset | h5py.Group) -> None:
        if isinstance(one, h5py.Dataset) and one.dtype.kind in "iuf" and one.size:
            found[name] = one[()]

    with h5py.File(path, "r") as file:
        file.visititems(take)
    assert found
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_pyfive_reads_what_the_library_reads(files, kind):
    pyfive = pytest.importorskip("pyfive")
    path = getattr(files, kind)
    wanted = arrays(path)
    with path.open("rb") as raw:
        file = pyfive.File(raw)
        for name, values in wanted.items():
            np.testing.assert_array_equal(file[name][...], values)


@pytest.mark.long
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not installed")
@pytest.mark.parametrize("kind", KINDS)
def test_octave_reads_what_the_library_reads(files, kind, tmp_path):
    path = getattr(files, kind)
    wanted = {name: values for name, values in arrays(path).items() if values.dtype.names is None}
    # By name: a recording's tables, which are compounds with text, end Octave's reading of a whole file.
    names = {name.partition("/")[0] for name in wanted} | ({"about", "rig"} if kind == "recording" else set())
    listed = ", ".join(f"'{name}'" for name in sorted(names))
    script = [f"s = load('-hdf5', '{path}', {listed});"]
    for number, name in enumerate(wanted):
        place = "s" + "".join(
            f".('{part}')" if not part.isdecimal() else f".('_{part}')" for part in name.split("/")
        )
        script.append(f"f = fopen('{tmp_path}/{number}', 'w'); fwrite(f, {place}, 'double'); fclose(f);")
    done = subprocess.run(
        ["octave-cli", "-q", "--eval", "\n".join(script)],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    for number, (name, values) in enumerate(wanted.items()):
        assert (tmp_path / str(number)).exists(), (name, done.stderr)
        # Octave's first index runs fastest, as HDF5's last does.
        np.testing.assert_array_equal(np.fromfile(tmp_path / str(number)), values.astype(float).ravel(), name)
