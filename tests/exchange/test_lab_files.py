"""Files as labs have them: what is understood of each is compared with what was written."""

import numpy as np
import pytest

import haploop
from haploop.exchange import FileMapping, understand
from haploop.exchange.importing import presses_in
from tests.exchange.lab_files import KINDS, Written, german, no_header
from tests.raising import raises

SAVED = ("none.csv", "pico.csv", "struct.mat", "plain.tdms", "millivolts.csv", "three.wav")


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Two presses of a push button on the twin."""
    with haploop.open_rig("simulated") as rig:
        found = haploop.record(rig, "push", "P01", 2, out=tmp_path_factory.mktemp("lab"))
    return Written(found.rate_hz, found.force, found.acceleration[2], found.activation, 2)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_what_was_written_is_understood(kind, written, tmp_path):
    """Values, rate and presses; and what only a person can know is asked, never guessed."""
    if kind.name.endswith(".xlsx"):
        pytest.importorskip("openpyxl")
    if kind.name.endswith(".tdms"):
        pytest.importorskip("nptdms")
    path = tmp_path / kind.name
    kind.write(path, written)
    bare = understand(path)
    for option in kind.lacks:
        raises(haploop.ConfigurationError, option, bare.require)
    if not kind.lacks:
        bare.require()
    found = understand(path, FileMapping(**kind.told))
    assert not found.questions, found.questions
    assert found.rate_hz == pytest.approx(written.rate_hz, rel=kind.rate_error)
    whole = len(next(iter(s for r, s in found.signals.items() if r != "time")).values)
    for role, signal in found.signals.items():
        true = {"force": written.force, "acceleration": written.acceleration}.get(role)
        if true is None:
            continue
        difference = signal.values - true[:whole]
        for hole in found.holes:
            difference[hole.first - 2 : hole.end + 2] = 0
        assert np.abs(difference).max() <= kind.error * np.abs(true).max(), role
    contact = found.signals.get("activation")
    if contact is not None:
        closed = contact.values > (contact.values.max() + contact.values.min()) / 2
        assert np.mean(closed != (written.switch[:whole] > 0.5)) < 1e-3
    presses = presses_in(found)
    assert len(presses) == (1 if kind.name == "sheet.xlsx" else written.presses)
    notes = " ".join(found.notes)
    assert all(one in notes for one in kind.said), notes


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("kind", [k for k in KINDS if k.name in SAVED], ids=lambda kind: kind.name)
def test_a_mapping_is_saved_and_says_it_all(kind, written, tmp_path):
    path, saved = tmp_path / kind.name, tmp_path / "lab.toml"
    if kind.name.endswith(".tdms"):
        pytest.importorskip("nptdms")
    kind.write(path, written)
    found = understand(path, FileMapping(**kind.told))
    found.mapping.save(saved)
    again = understand(path, FileMapping.load(saved))
    assert not again.questions and again.rate_hz == found.rate_hz
    for role, signal in found.signals.items():
        assert again.signals[role].why == "told"
        np.testing.assert_array_equal(again.signals[role].values, signal.values)


def test_the_command_shows_what_was_understood(run, written, tmp_path):
    path = tmp_path / "a.csv"
    german(path, written)
    shown = run("import", path, "--plot", tmp_path / "a.png")
    assert shown.exit_code == 0 and (tmp_path / "a.png").is_file()
    for part in ("Kraft", "decimal commas", "5000 samples/s", "2, at", "by its heading and unit", "Plot:"):
        assert part in shown.stdout, part
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "a.png"}


def test_the_command_says_what_it_lacks(run, written, tmp_path):
    path = tmp_path / "a.csv"
    no_header(path, written)
    shown = run("import", path)
    assert shown.exit_code == 0 and "Not said" in shown.stdout and "--force COLUMN" in shown.stdout
    refused = run("import", path, "-o", tmp_path / "a.h5")
    assert refused.exit_code == 2 and refused.stderr.count("\n") == 1 and "--force COLUMN" in refused.stderr
    assert not (tmp_path / "a.h5").exists()


def test_a_person_at_a_terminal_is_asked(run, written, tmp_path, monkeypatch):
    """One question after the other, until nothing is open; the answers are saved."""
    path = tmp_path / "a.csv"
    no_header(path, written)
    answers = iter(["5000", "1", "N"])
    asked: list[str] = []
    monkeypatch.setattr("haploop.exchange.commands.importing._at_a_terminal", lambda: True)
    monkeypatch.setattr(
        "haploop.exchange.commands.importing._ask",
        lambda question: asked.append(question.what) or next(answers),
    )
    saved = tmp_path / "lab.toml"
    shown = run("import", path, "--save-mapping", saved)
    assert shown.exit_code == 0 and len(asked) == 3, asked
    mapping = FileMapping.load(saved)
    assert mapping.rate_hz == 5000 and mapping.force == 1 and mapping.units["force"] == "N"


BARE = "".join(f"{k / 1000:.4f},{k % 7}\n" for k in range(2000))
TEXT = "t [s],F [N],a [m/s^2]\n" + "".join(f"{k / 1000:.4f},{1 + k % 7},{9.8 + k % 5}\n" for k in range(2000))


@pytest.mark.parametrize(
    ("content", "told", "sentence"),
    [
        ("0,1\n" * 50, {}, "--decimal"),
        ("Zeit,Kraft\n" + "".join(f"0,{k:04d},1,{k % 10}\n" for k in range(50)), {}, "semicolons or tabs"),
        (TEXT, {"force": "G"}, "no column 'G' for force: it has t [s], F [N], a [m/s^2]"),
        (TEXT, {"force": 1, "acceleration": "F"}, "same column"),
        (TEXT, {"units": {"force": "100 mV/g"}}, "no unit of force"),
        (TEXT, {"units": {"force": "0.1 V/N"}}, "needs no sensitivity"),
        (TEXT, {"units": {"force": "0 N"}}, "no unit of force"),
        (TEXT, {"units": {"force": "1e9 N"}}, "look at its unit"),
        (TEXT, {"rate_hz": 5.0}, "5 samples/s"),
        (TEXT.replace("0.5000,", "0.0001,"), {}, "goes back in time"),
        (TEXT.replace("0.5000,", "0.4990,"), {}, "the same time in samples 500 and 501"),
        (TEXT.replace("0.5000,", ","), {}, "no time in sample 501"),
        (TEXT.replace("0.0000,", ","), {}, "no time in sample 1:"),
        (TEXT[: len(TEXT) // 2] + "broken\n" + TEXT[len(TEXT) // 2 :], {}, "stops being a table"),
        ("Sample rate: 5000 Hz\n" + TEXT, {}, "say which is right"),
        ("t [ms];F [N]\n" + "1.000;0,003\n" * 50, {}, "no table of numbers"),
        ("\0\1\2" * 100, {}, "is no text"),
        ("", {}, "is empty"),
        (TEXT.replace("[N]", "[V]"), {}, "'force=0.25 V/N'"),
        (TEXT.replace("F [N]", "F1 [N]").replace("a [m/s^2]", "F2 [N]"), {}, "which of F1 [N], F2 [N]"),
        (BARE, {"time": 0, "force": 1}, "--unit force=N"),
    ],
)  # fmt: skip
def test_what_cannot_be_understood_is_one_sentence(tmp_path, content, told, sentence):
    path = tmp_path / "a.csv"
    path.write_text(content)
    with pytest.raises((haploop.ConfigurationError, haploop.DataError)) as error:
        understand(path, FileMapping(**told)).require()
    assert sentence in str(error.value) and "\n" not in str(error.value), str(error.value)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("suffix", [".npy", ".mat", ".h5", ".tdms", ".npz", ".wav"])
def test_a_file_of_noise_is_one_sentence(run, tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(bytes(np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8)))
    result = run("import", path)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1 and "Traceback" not in result.output


@pytest.mark.usefixtures("read_here")
def test_a_sign_that_must_be_wrong_is_asked_for(written, tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, fs=5000, force_N=-written.force, acc=-written.acceleration)
    units = {"acceleration": "m/s^2"}
    found = understand(path, FileMapping(units=units))
    raises(haploop.ConfigurationError, "--flip force and --flip acceleration", found.require)
    flipped = understand(path, FileMapping(units=units, flip=("force", "acceleration")))
    flipped.require()
    np.testing.assert_allclose(flipped.signals["force"].values, written.force)


def _held(start: float, up: float, down: float, end: float) -> np.ndarray:
    """N at 1000 samples/s for a second: a press held from `up` to `down` (s), between two rests."""
    t = np.arange(1000) / 1000
    held = np.clip((t - up) / 0.02, 0, 1) * np.clip((down - t) / 0.02, 0, 1)
    rest = np.where(t < 0.5 * (up + down), start, end)
    noise = np.random.default_rng(5).normal(0, 0.01, 1000)
    return np.asarray(rest + 2 * held + noise)


_TO_END, _FROM_START = _held(0, 0.05, 9, 0), _held(0, -1, 0.9, 0)


@pytest.mark.parametrize(
    ("force", "told", "asked", "rest", "presses"),
    [
        pytest.param(_held(0, 0.05, 0.95, 0), {}, "", "first and last", 1, id="held for 90 % of the file"),
        pytest.param(_held(7, 0.05, 0.95, 7), {}, "", "7 N, in its first", 1, id="held, with an offset"),
        pytest.param(-_held(0, 0.05, 0.95, 0), {}, "--flip force", "first and last", 0, id="held, downwards"),
        pytest.param(-_held(3, 0.05, 0.95, 3), {"flip": ("force",)}, "", "3 N", 1, id="turned as told"),
        pytest.param(_held(0, 0.4, 0.6, 0.5), {}, "", "0.5", 1, id="creep that leaves no doubt"),
        pytest.param(_TO_END, {}, "--rest force=start", "in its last", 1, id="held to the end"),
        pytest.param(_TO_END, {"rest": {"force": "start"}}, "", "as told", 1, id="rest at the start"),
        pytest.param(_TO_END, {"rest": {"force": "end"}}, "--flip force", "told", 0, id="rest at the end"),
        pytest.param(_FROM_START, {"rest": {"force": "end"}}, "", "last", 1, id="held from the start"),
    ],
)  # fmt: skip
def test_rest_is_before_and_after_the_press(tmp_path, force, told, asked, rest, presses):
    """However long a button is held; only ends that disagree on the direction are a question."""
    path = tmp_path / "a.csv"
    path.write_text("t [s],F [N]\n" + "".join(f"{k / 1000:.4f},{f:.5f}\n" for k, f in enumerate(force)))
    found = understand(path, FileMapping(**told))
    assert [q.option.partition(" or")[0] for q in found.questions] == ([asked] if asked else [])
    (said,) = (note for note in found.notes if note.startswith("Force at rest"))
    assert rest in said
    if presses:
        assert len(presses_in(found)) == presses


def test_a_recording_that_is_mostly_held_rests_before_its_press(run, tmp_path):
    """Told by the command's option, kept in the saved mapping, and tared where nobody presses."""
    path, saved = tmp_path / "a.csv", tmp_path / "lab.toml"
    force = 7 + _held(0, 0.2, 9, 0)
    path.write_text("t [s],F [N]\n" + "".join(f"{k / 1000:.4f},{f:.5f}\n" for k, f in enumerate(force)))
    run("import", path, "-o", tmp_path / "a.h5", "--as", "recording", "-p", "P01", "--button", "push",
        "--rest", "force=start", "--save-mapping", saved, ends=0)  # fmt: skip
    assert FileMapping.load(saved).rest == {"force": "start"}
    found = haploop.Recording.open(tmp_path / "a.h5").force
    assert np.median(found) == pytest.approx(2, abs=0.05)
    run("import", path, "--rest", "force", ends=2)
    run("import", path, "--rest", "force=middle", ends=2)
