"""MATLAB files between GNU Octave and haploop: all kinds in one run of Octave, which is slow to start."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.calibration import Calibration, VibrationMap
from tests.exchange.conftest import FREQUENCIES, velocity
from tests.exchange.test_signals import KINDS, expected

pytestmark = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not installed")

READ = r"""
for k = 1:numel(files)
  s = load([files{k} '.mat']);
  text = fopen([files{k} '.txt'], 'w');
  for name = fieldnames(s)'
    value = s.(name{1});
    if isnumeric(value)
      raw = fopen([files{k} '.' name{1}], 'w');
      if iscomplex(value)
        value = cat(1, real(value)(:), imag(value)(:));
      end
      fwrite(raw, value, 'double');
      fclose(raw);
    end
  end
  for name = fieldnames(s.units)'
    fprintf(text, '%s = %s\n', name{1}, s.units.(name{1}));
  end
  fprintf(text, 'simulated = %d\nsource = %s\n', s.about.simulated, s.about.source);
  if isfield(s, 'patches')
    fprintf(text, 'first = %s %s\nlast = %s %s\n', s.patches{1}, s.points{1}, s.patches{end}, s.points{end});
  end
  if isfield(s, 'A')
    fprintf(text, 'stable = %d\n', all(real(eig(s.A)) < 0));
  end
  fclose(text);
end
"""


def octave(script: str, folder: Path) -> None:
    command = ["octave-cli", "-q", "--eval", script]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_octave_opens_every_kind(files, measured_map, tmp_path):
    kinds = {kind: getattr(files, kind) for kind in (*KINDS, "calibration")} | {"map": measured_map}
    for kind, path in kinds.items():
        haploop.export_file(path, "mat", tmp_path / f"{kind}.mat")
    listed = ", ".join(f"'{kind}'" for kind in kinds)
    octave(f"files = {{{listed}}};{READ}", tmp_path)

    def said(kind):
        lines = (tmp_path / f"{kind}.txt").read_text(encoding="utf-8").splitlines()
        return dict(line.split(" = ", 1) for line in lines)

    def read(kind, name):
        return np.fromfile(tmp_path / f"{kind}.{name}")

    for kind, path in kinds.items():
        assert (said(kind)["simulated"], said(kind)["source"]) == ("1", path.name)
    for kind in KINDS:
        for name, (values, unit) in expected(files, kind).items():
            np.testing.assert_array_equal(read(kind, name), values)
            assert said(kind)[name] == unit
    calibration = Calibration.load(files.calibration)
    np.testing.assert_array_equal(read("calibration", "frequency"), FREQUENCIES)
    parts = np.concatenate([velocity().real, velocity().imag])
    np.testing.assert_array_equal(read("calibration", "velocity"), parts)
    np.testing.assert_array_equal(read("calibration", "coherence"), calibration.response.coherence)
    A, *_ = calibration.model.state_space()
    np.testing.assert_array_equal(read("calibration", "A"), A.ravel(order="F"))
    assert said("calibration")["velocity"] == "(m/s)/V" and said("calibration")["stable"] == "1"
    f = read("map", "frequency")
    found = VibrationMap.load(measured_map)
    own = np.concatenate([found.velocity("A", f), found.velocity("B", f)])
    parts = read("map", "velocity").reshape(2, len(f), len(own))  # Octave writes columns
    np.testing.assert_array_equal(parts[0].T, own.real)
    np.testing.assert_array_equal(parts[1].T, own.imag)
    assert (said("map")["first"], said("map")["last"]) == ("A 3", "B 17")
    np.testing.assert_array_equal(read("map", "rows"), [0, 1, 0, 1])
    np.testing.assert_array_equal(read("map", "columns"), [3, 5, 3, 5])


@pytest.mark.long
def test_a_press_that_octave_saved_is_imported(tmp_path, run):
    """In g at 10 kHz, as somebody else would save it."""
    script = (
        "t = (0:4999)' / 10000; click = 2 * exp(-((t - 0.2) / 0.004) .^ 2) "
        ".* sin(2 * pi * 240 * t); fs = 10000; units.click = 'g'; "
        "save('-v7', 'click.mat', 'click', 'fs', 'units');"
    )
    octave(script, tmp_path)
    told = ("--acceleration", "click", "--button", "click")
    run("import", tmp_path / "click.mat", *told, "--out", tmp_path / "a.h5", ends=0)
    press = haploop.Representative.load(tmp_path / "a.h5")
    assert press.rate_hz == 5000.0 and not press.simulated
    t = np.arange(5000) / 10_000
    saved = 2 * 9.81 * np.exp(-(((t - 0.2) / 0.004) ** 2)) * np.sin(2 * np.pi * 240 * t)
    assert np.abs(press.acceleration).max() == pytest.approx(np.abs(saved).max(), rel=0.01)
    assert np.sum(press.acceleration**2) / 5000 == pytest.approx(np.sum(saved**2) / 10_000, rel=0.01)
