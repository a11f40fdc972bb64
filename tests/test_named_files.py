"""What a file from another person may reach by the paths in it: what lies beside it, or below."""

import json
from pathlib import Path

import pytest

from haploop.acquisition.recording.rows import Event
from haploop.acquisition.recording.streams import file_problems
from haploop.base.errors import ConfigurationError, HaploopError
from haploop.base.files import beside
from haploop.base.line_files import Mark, check_marked, write_marks
from haploop.calibration.recalibration.history import Generation
from haploop.experiments import load_experiment
from haploop.instruments import load_rig_file
from tests.raising import raises

OUT = ["../out", "sub/../../out", "/out", "C:/out", "C:out", "//host/out", r"..\out", "link/out", "loop", "",
    ".."]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a file outside of it, one within, a link to each, and a loop."""
    (tmp_path / "out").write_text("10, 1, 0\n100, 1, 0\n")
    folder = tmp_path / "theirs"
    (folder / "sub").mkdir(parents=True)
    (folder / "sub" / "in").write_text("10, 1, 0\n100, 1, 0\n")
    (folder / "link").symlink_to(tmp_path)
    (folder / "file").symlink_to(tmp_path / "out")
    (folder / "within").symlink_to("sub/in")
    (folder / "loop").symlink_to("loop")
    return folder


@pytest.mark.parametrize("place", [*OUT, "file", "a\0b"])
def test_a_place_that_leads_out_is_refused(folder, place):
    with pytest.raises(ConfigurationError, match=r"It names .* leads out of its folder: copy that file into"):
        beside(folder, place, "It")


@pytest.mark.parametrize("place", ["sub/in", "within", "not-yet", "sub/not-yet"])
def test_a_place_within_is_taken(folder, place):
    assert beside(folder, place, "It") == folder / place


def of_a_rig(folder: Path, key: str, place: str) -> None:
    path = folder / "rig.toml"
    sensor = {"calibration": "force", "frf": "acceleration"}[key]
    path.write_text(f'base = "haptable"\n[sensors.{sensor}]\n{key} = {json.dumps(place)}\n', encoding="utf-8")
    load_rig_file(path)


def of_an_experiment(folder: Path, key: str, place: str) -> None:
    text = load_experiment("matching").path.read_text(encoding="utf-8")
    text = "\n".join(line.removeprefix("#: ").removeprefix("#:") for line in text.splitlines())
    before = 'push = "push.h5"'
    assert before in text
    named = f"push = {json.dumps(place)}"
    if key == "releases":
        named = f"{before}\n[surface.releases]\npush = {json.dumps(place)}"
    (folder / "experiment.toml").write_text(text.replace(before, named), encoding="utf-8")
    load_experiment(folder)


def of_a_log(folder: Path, _key: str, place: str) -> None:
    write_marks(folder, {place: Mark(1, "")})
    check_marked(folder / "marks.json")


def of_a_calibration(folder: Path, _key: str, place: str) -> None:
    Generation(folder, "", "", "", {}, {place: "0" * 64}, "").verify()


def of_a_recording(folder: Path, _key: str, place: str) -> None:
    said = {"instrument": "x", "name": "y", "file": place, "sha256": "0" * 64}
    for sentence in file_problems([Event(0, "file", json.dumps(said))], folder):
        raise HaploopError(sentence)


@pytest.mark.parametrize("place", ["../out", "file", "link/out"])
@pytest.mark.parametrize(
    ("reads", "key"),
    [
        (of_a_rig, "calibration"),
        (of_a_rig, "frf"),
        (of_an_experiment, "buttons"),
        (of_an_experiment, "releases"),
        (of_a_log, ""),
        (of_a_calibration, ""),
        (of_a_recording, ""),
    ],
)
def test_every_path_in_a_file_is_looked_at(folder, reads, key, place):
    raises(HaploopError, "leads out of its folder", reads, folder, key, place)


def test_a_base_is_a_rig_file_and_no_device(folder):
    (folder / "rig.toml").write_text('base = "/dev/zero"\n')
    raises(ConfigurationError, r"line 1: there is no rig '/dev/zero'", load_rig_file, folder / "rig.toml")
