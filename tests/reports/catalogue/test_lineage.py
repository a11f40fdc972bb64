"""What was made from what is told by content hashes: never by a name that a file happens to have today."""

import shutil
from pathlib import Path

import pytest

import haploop
from haploop.calibration import Check, DigitalButton
from haploop.reports.catalogue import Entry, Lineage, lineage
from haploop.reports.catalogue.entry import Source, packed


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """Two recordings, the digital buttons made of them, and a later check of one."""
    data = Path(shutil.copytree(made, tmp_path / "data"))
    DigitalButton.load(data / "latch.h5").check.save(data / "again.h5")
    return data


def seen(folder: Path, name: str) -> Lineage:
    entries = haploop.list_files([folder], index=folder.parent / "index.sqlite3")
    return lineage(entries, str(folder / name))


def told(found: Lineage) -> dict[str, str]:
    return {one.name: one.note for node in found.nodes for one in node.members}


def pairs(found: Lineage) -> set[tuple[str, str]]:
    names = [node.members[0].name for node in found.nodes]
    return {(names[first], names[second]) for first, second in found.edges}


def test_a_recording_leads_to_the_button_and_its_check_and_back(folder):
    chain = {("P01-latch.h5", "latch.h5"), ("latch.h5", "again.h5")}
    assert pairs(seen(folder, "P01-latch.h5")) == chain
    found = seen(folder, "again.h5")
    assert pairs(found) == chain | {("patch A at button", "latch.h5")}
    assert [node.level for node in found.nodes] == [0, 0, 1, 2]
    assert [node.here for node in found.nodes] == [False, False, False, True]


def swap(folder: Path) -> None:
    (folder / "P01-latch.h5").unlink()
    (folder / "P01-push.h5").rename(folder / "P01-latch.h5")


def cut(folder: Path) -> None:
    whole = (folder / "P01-latch.h5").read_bytes()
    (folder / "P01-latch.h5").write_bytes(whole[:-1000])


def copy(folder: Path) -> None:
    shutil.copy(folder / "P01-latch.h5", folder / "twice.h5")


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "name", "said"),
    [
        (lambda folder: None, "P01-latch.h5", ""),
        (lambda folder: (folder / "P01-latch.h5").unlink(), "P01-latch.h5", "not in this folder"),
        (lambda folder: (folder / "P01-latch.h5").rename(folder / "first.h5"), "first.h5",
         "called P01-latch.h5 when it was used"),
        (swap, "P01-latch.h5", "has other contents"),
        (cut, "P01-latch.h5", "is damaged"),
        (copy, "P01-latch.h5", "the same contents are in"),
    ],
)  # fmt: skip
def test_what_became_of_a_source_is_said(folder, change, name, said):
    change(folder)
    found = seen(folder, "latch.h5")
    assert said in told(found)[name] and bool(said) == bool(told(found)[name])
    there = next(one for node in found.nodes for one in node.members if one.name == name)
    gone = said.startswith(("not in", "has other", "is damaged"))
    assert there.file == ("" if gone else str(folder / name))


def test_many_files_with_the_same_neighbours_are_one_box():
    recordings = [Entry(f"/d/P{k:02}.h5", "recording", content_hash=f"r{k}") for k in range(12)]
    sources = packed(Source("recording", f"P{k:02}.h5", f"r{k}") for k in range(12))
    press = Entry("/d/press.h5", "representative", content_hash="p", made_from=sources)
    found = lineage([*recordings, press], press.file)
    assert [len(node.members) for node in found.nodes] == [12, 1] and found.edges == ((0, 1),)
    alone = lineage([*recordings, press], recordings[3].file)
    assert [(n.kind, n.here) for n in alone.nodes] == [("recording", True), ("representative", False)]
    assert lineage([press], "/d/other.h5").nodes == ()


@pytest.mark.parametrize(
    ("source", "others", "before"),
    [
        (Source("map", "", "ab" * 8), [Entry("/d/map", "map", content_hash="plan")], "a map"),
        (Source("waveforms", "", "c"), [], None),
        (Source("waveforms", "", "c"), [Entry("/d/w.h5", "waveforms", content_hash="w", holds="c")], "w.h5"),
        (Source("original", "lab.uff", "d"), [], "lab.uff"),
        (Source("calibrations", "of patches A, B", "e"), [], "of patches A, B"),
        (Source("button", "/d/latch.h5", ""), [Entry("/d/latch.h5", "button", content_hash="b")], "latch.h5"),
        (Source("button", "/d/latch.h5", ""), [], "latch.h5"),
        (Source("drive", "", "f"), [Entry("/d/b.h5", "button", content_hash="b", holds="x f")], "b.h5"),
        (Source("drive", "", "f", (Source("recording", "P01.h5", "r"),)), [], "P01.h5"),
    ],
)
def test_each_kind_of_source_is_found_as_files_state_it(source, others, before):
    own = Entry("/d/own.h5", "calibration", content_hash="c", made_from=packed([source]))
    found = told(lineage([*others, own], own.file))
    assert [*found] == [*([before] if before else []), "own.h5"]


def test_a_check_of_a_drive_of_its_own_names_its_recordings(folder):
    assert Check.load(folder / "again.h5").drive.sources
    (folder / "latch.h5").unlink()
    found = pairs(seen(folder, "again.h5"))
    assert ("P01-latch.h5", "again.h5") in found and ("patch A at button", "again.h5") in found
