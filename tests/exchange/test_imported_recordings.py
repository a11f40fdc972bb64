"""A whole recording of another program is a recording like one's own: segmented, judged, represented."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.acquisition import Recording
from haploop.exchange import FileMapping, import_recording, understand
from tests.exchange.lab_files import Kind, Written, german, jitter, old_tektronix

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.fixture(scope="session")
def own(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Five presses of a push button on the twin."""
    with haploop.open_rig("simulated") as rig:
        return haploop.record(rig, "push", "P01", 5, out=tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="session")
def presses(own: Recording) -> Written:
    return Written(own.rate_hz, own.force, own.acceleration[2], own.activation, 5)


TOLD = FileMapping(participant="P02", button="push")
KINDS = (Kind("a.csv", german), Kind("b.csv", jitter, error=0.02))


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_presses_are_the_same_presses(kind, own, presses, tmp_path):
    path, out = tmp_path / kind.name, tmp_path / "out.h5"
    kind.write(path, presses)
    os.utime(path, (1.6e9, 1.6e9))
    found = import_recording(path, TOLD, out)
    assert found.complete and not found.simulated and haploop.verify(out) == ()
    assert (found.participant, found.button, found.rate_hz) == ("P02", "push", 5000)
    assert len(found.accepted) == len(own.accepted) == 5
    theirs, mine = (np.array([p.force for p in r.accepted]) for r in (found, own))
    np.testing.assert_allclose(theirs, mine, atol=0.02)
    shift = [p.activation - q.activation for p, q in zip(found.accepted, own.accepted, strict=True)]
    assert np.abs(shift).max() < 1.5  # the delays of a multiplexed card are not in the file
    assert found.imported["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert "Dated 2020-09-13T12:26:40+00:00 by the file's last change" in " ".join(found.imported["notes"])
    heading = {"a.csv": "Kraft [N]", "b.csv": "force [N]"}[kind.name]
    assert found.imported["file"] == kind.name and found.imported["mapping"]["force"] == heading
    press = haploop.representative([found])
    assert press.members == 5 and not press.left_out
    reference = haploop.representative([own])
    n = min(len(press.acceleration), len(reference.acceleration))
    assert np.corrcoef(press.acceleration[:n], reference.acceleration[:n])[0, 1] > 0.9


@pytest.mark.long
def test_an_imported_press_is_pressed_into_the_table(presses, tmp_path, run, demo):
    """As the README goes on: represent, button make, in its own words."""
    german(tmp_path / "a.csv", presses)
    out, press = tmp_path / "out.h5", tmp_path / "press.h5"
    run("import", tmp_path / "a.csv", "-p", "P02", "--button", "push", "-o", out, ends=0)
    shown = run("show", out)
    assert shown.exit_code == 0 and "Imported" in shown.stdout and "a.csv" in shown.stdout
    run("represent", out, "--out", press, ends=0)
    table, button = demo.folder / "calibration.h5", tmp_path / "button.h5"
    run("button make", out, "-c", table, "-o", button, "--iterations", 0, ends=0)


def test_a_file_without_a_switch_or_an_accelerometer(presses, tmp_path):
    """Its force alone: the presses and their snaps are found, and there is no press to feel."""
    old_tektronix(tmp_path / "a.csv", presses)
    units = {"time": "s", "force": "0.1 V/N"}
    told = FileMapping(participant="P02", button="push", time=0, force=1, units=units)
    found = import_recording(tmp_path / "a.csv", told, tmp_path / "out.h5")
    assert len(found.accepted) == 5
    with pytest.raises(haploop.ConfigurationError, match="motion"):
        haploop.representative([found])


def test_a_press_that_was_filled_is_not_accepted(presses, tmp_path):
    """20 ms around the third activation are lost."""
    rises = np.flatnonzero(np.diff(presses.switch) > 0.5)
    third = int(rises[np.concatenate([[True], np.diff(rises) > 2500])][2])
    values = np.delete(presses.columns(), slice(third - 50, third + 50), axis=0)
    np.savetxt(tmp_path / "a.csv", values, delimiter=",", comments="", fmt="%.9g",
               header="time [s],force [N],acceleration [m/s^2],switch")  # fmt: skip
    found = import_recording(tmp_path / "a.csv", TOLD, tmp_path / "out.h5")
    assert [p.number for p in found.verdicts if not p.accepted] == [3]
    bad = found.verdicts[2]
    assert "sensor" in bad.flags and "20 ms of all signals are missing" in bad.reason
    assert haploop.representative([found]).members == 4
    assert any(event.kind == "filled" for event in found.events)


def test_a_clipped_signal_is_saturated(presses, tmp_path):
    acceleration = np.clip(presses.acceleration, None, 12.0)
    np.savez(tmp_path / "a.npz", fs=5000, force_N=presses.force, acceleration=acceleration, sw=presses.switch)
    told = FileMapping(participant="P02", button="push", units={"acceleration": "m/s^2"})
    found = import_recording(tmp_path / "a.npz", told, tmp_path / "out.h5")
    assert all("saturated" in p.flags for p in found.verdicts)


@pytest.mark.parametrize("rate_hz", [1000, 4999.99, 44_100])
def test_other_rates_become_ours(presses, tmp_path, rate_hz):
    from scipy.signal import resample_poly

    force, acceleration = (
        resample_poly(v - v[0], round(rate_hz / 100), 50) + v[0]
        for v in (presses.force, presses.acceleration)
    )
    at = np.arange(len(force)) * presses.rate_hz / rate_hz
    switch = presses.switch[np.minimum(np.rint(at).astype(int), len(presses.switch) - 1)]
    np.savez(tmp_path / "a.npz", fs=rate_hz, force_N=force, acceleration=acceleration, sw=switch)
    told = FileMapping(participant="P02", button="push", units={"acceleration": "m/s^2"})
    found = import_recording(tmp_path / "a.npz", told, tmp_path / "out.h5")
    assert found.rate_hz == 5000 and len(found.accepted) == 5
    assert any(f"Resampled from {rate_hz:g}" in one for one in found.imported["notes"])


def test_many_files_by_one_mapping(presses, tmp_path, run):
    """Names say who pressed what; a file that is not like the others is said, and the others go on."""
    folder = tmp_path / "lab"
    folder.mkdir()
    for who in ("P01", "P02"):
        german(folder / f"{who}_push_monday.csv", presses)
    (folder / "P03_push_monday.csv").write_text("Zeit [s];Weg [mm]\n" + "0;1\n" * 30)
    (folder / "notes.csv").write_text("nothing\n")
    saved, out = tmp_path / "lab.toml", tmp_path / "out"
    names = "{participant}_{button}_*"
    run("import", folder / "P01_push_monday.csv", "--names", names, "--save-mapping", saved, ends=0)
    done = run("import", *sorted(folder.iterdir()), "--mapping", saved, "--out", out)
    assert done.exit_code == 2 and "2 of 4 files were not imported" in done.stdout
    assert "no column 'Kraft [N]'" in done.stdout and "is not named as" in done.stdout
    made = sorted(out.iterdir())
    assert [p.name for p in made] == ["P01_push_monday.h5", "P02_push_monday.h5"]
    assert [Recording.open(p).participant for p in made] == ["P01", "P02"]
    again = run("import", *sorted(folder.iterdir()), "--mapping", saved, "--out", out, "--json")
    told = {Path(one["file"]).name: one["error"] for one in json.loads(again.stdout)["files"]}
    assert again.exit_code == 2 and "exists" in told["P01_push_monday.csv"]


def test_a_file_without_a_press_is_no_recording(tmp_path):
    rest = np.random.default_rng(2).normal(0, 0.01, 5000)
    np.savez(tmp_path / "a.npz", fs=5000, force_N=rest)
    told = TOLD.model_copy(update={"make": "recording"})
    with pytest.raises(haploop.DataError, match="shows no press in 1 s"):
        import_recording(tmp_path / "a.npz", told, tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


def test_a_saved_mapping_does_not_say_who_pressed_who_is_asked_for(presses, tmp_path, run):
    """A hundred files would silently be one participant's."""
    german(tmp_path / "a.csv", presses)
    saved, out = tmp_path / "lab.toml", tmp_path / "out.h5"
    refused = run("import", tmp_path / "a.csv", "-o", out, says="--participant P01 and --button NAME")
    assert refused.stderr.count("\n") == 1 and not out.exists()
    told = ("-p", "P07", "--button", "push", "--save-mapping", saved)
    run("import", tmp_path / "a.csv", *told, ends=0)
    mapping = FileMapping.load(saved)
    assert mapping.force == "Kraft [N]" and mapping.participant is None and mapping.button is None


def test_a_file_of_haploop_needs_no_import(tmp_path):
    with haploop.open_rig("simulated") as rig:
        haploop.record(rig, "push", "P01", 1, tmp_path)
    with pytest.raises(haploop.ConfigurationError, match="is a recording of haploop already"):
        understand(tmp_path / "P01-push.h5")
