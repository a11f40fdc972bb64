"""A session on tape: recorded on the wire, played without one, bit by bit; and tapes that were changed."""

import gzip
import json
import re
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import grpc
import h5py
import numpy as np
import pytest

import haploop
from haploop.base import entry_points
from haploop.base.clock import RealClock, VirtualClock
from haploop.base.errors import ConfigurationError, DataError, HaploopError, InstrumentError
from haploop.instruments import Rig, played, recorded
from haploop.instruments.camera import opencv
from haploop.instruments.camera.opencv import OpenCvCamera
from haploop.instruments.driver import settings_of
from haploop.instruments.tape import Failure, Player, Recorder, TapedLine, TapeError, TapeLines, mask, on_line
from haploop.instruments.tape.tape_file import TapeWriter, read_tape
from haploop.mocks.simulation import Simulation
from tests.acquisition.session.test_other_daqs import ALONG
from tests.acquisition.session.test_other_daqs import SERIAL as SERIAL_ADC
from tests.instruments.camera.test_camera import Feed
from tests.mutating import within_memory
from tests.raising import raises, raising


def lines(tape: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in gzip.decompress(tape.read_bytes()).splitlines()]


def press(rig: Rig, folder: Path) -> Path:
    return Path(haploop.record(rig, button="latch", participant="P01", presses=2, out=folder).path)


@pytest.fixture
def nothing_is_opened(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Call it, and no socket is opened any more, and no NI library chosen."""

    def close() -> None:
        refuse = raising(AssertionError("a tape opens nothing"))
        monkeypatch.setattr(socket.socket, "connect", refuse)
        monkeypatch.setattr(grpc, "insecure_channel", refuse)
        monkeypatch.setattr("nidaqmx._library_interpreter.LibraryInterpreter", refuse)

    return close


def begun(tape: Path) -> Player:
    player = Player(tape)
    player.begin()
    return player


def content(path: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            text = item.dtype.kind == "O"
            found[name] = str(item[()]).encode() if text else item[...].tobytes()
        found.update({f"{name}@{key}": np.asarray(value).tobytes() for key, value in item.attrs.items()})

    with h5py.File(path) as file:
        file.visititems(take)
        found.update({f"@{key}": str(value).encode() for key, value in file.attrs.items()})
    return found


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, int]:
    """A tape of a recording over the wire, the recording, and how many calls there were."""
    folder = tmp_path_factory.mktemp("day")
    tape = folder / "day.tape"
    with (
        recorded(tape) as recorder,
        haploop.open_rig("simulated", simulate="wire") as rig,
    ):
        recording = press(rig, folder / "wire")
    return tape, recording, recorder.calls


@pytest.mark.long
def test_a_recording_over_the_wire_is_played_again_bit_by_bit(day, tmp_path, nothing_is_opened):
    tape, first, calls = day
    nothing_is_opened()
    with played(tape) as player, haploop.open_rig(simulate=f"tape:{tape}") as rig:
        assert rig.simulated
        second = press(rig, tmp_path / "tape")
    assert player.answered == player.calls == calls
    one, other = content(first), content(second)
    assert one.keys() == other.keys()
    # Hash and checksum are of the time at which a session began, too.
    assert {key for key in one if one[key] != other[key]} <= {"@started", "@header_hash", "checksum"}
    assert len(one["codes"]) > 100_000


RIGS = {
    "bench": 'base = "bench"\n[table]\npatches = ["A"]\n',
    "sound-card": 'base = "sound-card"\n[table]\npatches = ["A"]\n',
    "serial": 'base = "simulated"\n[relay]\ndriver = "serial-relay"\nport = "COM9"\nrating = 60\n'
    'patches = { A = 0 }\n[table]\npatches = ["A"]\n',
}
"""One patch is enough for the others to tell."""


@pytest.mark.long
@pytest.mark.usefixtures("few_callbacks")
@pytest.mark.parametrize("rig", [pytest.param(n, marks=[pytest.mark.night] * (n != "bench")) for n in RIGS])
def test_doctor_of_a_tape(rig, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(RIGS[rig])
    words = ["doctor", "--json"]
    wire = run(*words, "--rig", "lab.toml", "--simulate", "wire", "--tape", "day.tape")
    tape = run(*words, "--simulate", "tape:day.tape")
    first, second = (json.loads(ran.stdout)["findings"] for ran in (wire, tape))
    assert wire.exit_code == tape.exit_code and len(first) > 10
    assert not [f for f in second if "tape" in f["sentence"] and f["name"] != "Lockout"]
    # The log of a play is a folder of its own.
    assert [f for f in first if f["name"] != "Lockout"] == [f for f in second if f["name"] != "Lockout"]
    held = re.search(r"day.tape holds (\d+) calls", wire.stderr)
    assert held and f"{held[1]} of the tape's {held[1]} calls were asked for" in tape.stderr


def test_the_first_call_that_differs_is_told(day, tmp_path):
    tape, _, _ = day
    other = tmp_path / "rig.toml"
    other.write_text('base = "simulated"\n[daq.channels]\ngauge0 = { terminal = "Dev1/ai9", range = 10 }\n')
    asked = r"Asked: daq create_ai_voltage_chan\(object \d+, 'Dev1/ai9'"
    with pytest.raises(InstrumentError, match=asked) as told:  # noqa: SIM117
        with haploop.open_rig(other, simulate=f"tape:{tape}") as rig:
            press(rig, tmp_path / "tape")
    assert re.search(r"On the tape \(call \d+, at \d+\.\d+ s\): daq create_ai_voltage", str(told.value))


def test_an_error_on_the_wire_is_the_same_error_on_tape(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(
        'base = "simulated"\n[[simulation.faults]]\nkind = "reply"\ninstrument = "relay"\nhow = "silence"\n'
        'asked = "pulseTimer"\n'
    )
    tape = tmp_path / "day.tape"
    said = []
    for session in (recorded(tape), played(tape)):
        simulate = "wire" if not said else f"tape:{tape}"
        with session, pytest.raises(InstrumentError) as error:  # noqa: SIM117
            with haploop.open_rig(rig if not said else None, simulate=simulate) as opened:
                haploop.calibrate(opened, patch="A", point="button")
        said.append(str(error.value))
    assert "did not answer within" in said[0]
    assert said[0] == said[1]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tape = tmp_path_factory.mktemp("whole") / "day.tape"
    with recorded(tape), haploop.open_rig("simulated", simulate="wire"):
        pass
    return tape


def test_a_tape_that_was_cut_off_is_found_wherever_it_was_cut(whole, tmp_path):
    data, cut = whole.read_bytes(), tmp_path / "cut.tape"
    calls = Player(whole).calls
    for length in range(1, len(data), max(1, len(data) // 97)):
        cut.write_bytes(data[:length])
        try:
            player = Player(cut)
        except HaploopError as error:
            assert str(cut) in str(error)
        else:
            # Without gzip's own end, an empty block and a checksum, every line is there with its hash.
            assert not player.whole or length >= len(data) - 16
            assert player.calls == calls if player.whole else player.calls <= calls
    # Every line but the last: what a program leaves that was killed.
    cut.write_bytes(gzip.compress(b"".join(gzip.decompress(data).splitlines(True)[:-1])))
    assert not Player(cut).whole and Player(cut).calls == calls


def test_a_tape_that_was_changed_in_any_place_is_refused(whole, tmp_path):
    data, changed = whole.read_bytes(), tmp_path / "changed.tape"
    for place in range(0, len(data), max(1, len(data) // 200)):
        # Bytes 4 to 9 of gzip's head say nothing of the content.
        if not 4 <= place < 10:
            changed.write_bytes(data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :])
            try:
                found = TapeLines.of(changed)
            except HaploopError:
                continue
            # A bit between two blocks of deflate says nothing.
            assert not found.whole or found == TapeLines.of(whole)
    texts = gzip.decompress(data).splitlines(True)
    for other in (
        [*texts[:5], *texts[6:]],
        [*texts[:5], texts[6], texts[5], *texts[7:]],
        [*texts, texts[-1]],
        [texts[0], texts[3].replace(b'"at":0.0', b'"at":0.1'), *texts[4:]],
    ):
        changed.write_bytes(gzip.compress(b"".join(other)))
        raises(DataError, "was changed", Player, changed)
    changed.write_bytes(data + data)
    raises(DataError, "something follows", Player, changed)


@pytest.mark.parametrize("text", [b"", b"no tape", gzip.compress(b"{}\n", mtime=0), b"\x1f\x8b"])
def test_another_file_is_no_tape(text, tmp_path):
    path = tmp_path / "x.tape"
    path.write_bytes(text)
    raises(HaploopError, "tape", haploop.open_rig, simulate=f"tape:{path}")


def test_a_tape_that_unpacks_to_more_than_any_session_is_refused(tmp_path):
    path = tmp_path / "large.tape"
    with gzip.open(path, "wb") as file:
        for _ in range(80):
            file.write(bytes(1 << 20))
    with within_memory(), pytest.raises(DataError, match="unpacks to more than 6"):
        read_tape(path)


def test_a_twin_and_a_driver_without_a_line_are_refused(tmp_path):
    with (
        pytest.warns(UserWarning, match="Nothing was recorded"),
        recorded(tmp_path / "a.tape"),
        pytest.raises(ConfigurationError, match="A twin makes no calls"),
    ):
        haploop.open_rig("simulated", simulate="twin")


def test_threads_keep_their_own_order_and_no_other(tmp_path):
    tape = tmp_path / "threads.tape"
    turn = threading.Barrier(2)

    def session(deck: Any, name: str, slow: bool) -> list[int]:
        line, answers = TapedLine(deck, "daq"), []
        for number in range(5):
            if slow:
                turn.wait(5)
            answers.append(line.call(f"{name} {number}", lambda n=number: 10 * n))
            if not slow:
                turn.wait(5)
        return answers

    def both(deck: Any, slow: str) -> dict[str, list[int]]:
        got: dict[str, list[int]] = {}
        threads = [
            threading.Thread(target=lambda n=name: got.update({n: session(deck, n, n == slow)}))
            for name in ("one", "two")
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return got

    with Recorder(tape) as recorder:
        recorder.begin("{}", "wire", RealClock())
        first = both(recorder, "one")
    player = begun(tape)
    assert both(player, "two") == first and player.answered == 10


def test_arrays_and_numbers_come_back_as_they_were(tmp_path):
    tape = tmp_path / "values.tape"
    values = [
        np.arange(12.0).reshape(3, 4).T, np.array([np.nan, np.inf, -0.0]), np.zeros((2, 0)), b"\xff\n",
        (1, (2,)), {"a": [None, True, "é"]}, np.float64(0.1), float("nan"),
    ]  # fmt: skip
    filled = np.empty((2, 3), np.int16)

    def answer(value: Any, into: Any) -> Any:
        into[...] = 7
        return value

    with Recorder(tape) as recorder:
        recorder.begin("{}", None, RealClock())
        line = TapedLine(recorder, "x")
        for value in values:
            line.call("do", lambda v=value: answer(v, filled), value, filled=(filled,))
        raises(ConnectionError, "", line.call, "fail", open_port, failures=(Failure(ConnectionError),))
    line = TapedLine(begun(tape), "x")
    for value in values:
        filled[...] = 0
        got = line.call("do", lambda: None, value, filled=(filled,))
        assert repr(got) == repr(value.item() if isinstance(value, np.generic) else value)
        assert (filled == 7).all()
    with pytest.raises(ConnectionError, match="no such port"):
        line.call("fail", lambda: None, failures=(Failure(ConnectionError),))


open_port = raising(ConnectionError("no such port"))


@pytest.mark.long
def test_a_masked_tape_has_no_serial_number_and_plays_the_same(tmp_path):
    tape, masked = tmp_path / "day.tape", tmp_path / "mail.tape"
    with recorded(tape), haploop.open_rig("bench", simulate="wire") as rig:
        identities = [i.identity for i in rig.instruments.values() if hasattr(i, "identity")]
        same = press(rig, tmp_path / "wire")
    serials = re.findall(r"(MXCOUPL1-\d+)|(MY\d+)|serial ([0-9A-F]+)", " ".join(identities))
    secret = ["".join(found) for found in serials]
    assert len(secret) == 4
    assert mask(tape, masked, ["P01"]) >= len(secret) + 1
    text = gzip.decompress(masked.read_bytes()).decode()
    said = " ".join(line for line in text.splitlines() if '"filled"' not in line)
    assert not [number for number in [*secret, "P01"] if number in said and len(number) > 3]
    with haploop.open_rig(simulate=f"tape:{masked}") as rig:
        other = haploop.record(rig, button="latch", participant="X01", presses=2, out=tmp_path / "mail")
    assert content(Path(other.path))["codes"] == content(same)["codes"]


def test_a_program_that_is_killed_leaves_a_tape_that_plays(tmp_path):
    tape = tmp_path / "killed.tape"
    recorder = Recorder(tape)
    recorder.__enter__()
    recorder.begin("{}", None, RealClock())
    line = TapedLine(recorder, "x")
    for number in range(20):
        line.call("do", lambda n=number: n)
    deadline = RealClock().now() + 5
    while RealClock().now() < deadline:
        RealClock().sleep(0.05)
        copy = tmp_path / "copy.tape"
        copy.write_bytes(tape.read_bytes())
        try:
            if Player(copy).calls == 20:
                break
        except HaploopError:
            continue
    player = Player(copy)
    assert player.calls == 20 and not player.whole
    recorder.__exit__(None, None, None)
    assert Player(tape).whole


def test_a_play_in_real_time_with_the_relay_s_renewals_is_played_again(tmp_path):
    """As on hardware: a rig that is not simulated, on devices that are served; threads of their own renew."""
    file = haploop.load_rig_file("simulated")
    world = Simulation(file, RealClock())
    served = tmp_path / "served.toml"
    tape = tmp_path / "day.tape"
    t = np.arange(75_000) / 50_000
    wave = 5 * np.hanning(len(t)) * np.sin(2 * np.pi * 200 * t)
    try:
        found: dict[str, Any] = {}
        for role, device in file.devices.items():
            driver: Any = entry_points.driver_class(device.driver, role)
            if role in ("daq", "relay"):
                found |= world.serve(device.driver, settings_of(driver, device, role, "served"))
            else:
                world.instrument(role, device, driver, "twin")
        served.write_text(
            f'base = "haptable"\nname = "served"\n[daq]\nserver = "{found["server"]}"\n'
            f'[relay]\nhub = "{found["hub"]}"\ndead_man = 2.0\n'
        )
        with recorded(tape), haploop.open_rig(served) as rig:
            first = rig.excite(wave, ["A"], ["drive", "laser"])
    finally:
        world.close()
    renewals = [line for line in lines(tape) if line.get("is") == "thread" and "renewal" in line["name"]]
    assert renewals
    with haploop.open_rig(simulate=f"tape:{tape}") as rig:
        assert rig.simulated
        second = rig.excite(wave, ["A"], ["drive", "laser"])
    assert first.volts.tobytes() == second.volts.tobytes()


@pytest.mark.long
@pytest.mark.parametrize("text", [SERIAL_ADC, ALONG], ids=["only DAQ", "along"])
def test_a_board_that_sends_by_itself_is_played_again_bit_by_bit(text, tmp_path):
    tape, file = tmp_path / "day.tape", tmp_path / "rig.toml"
    file.write_text(text)
    with recorded(tape), haploop.open_rig(file, simulate="wire") as rig:
        first = press(rig, tmp_path / "wire")
    with haploop.open_rig(simulate=f"tape:{tape}") as rig:
        second = press(rig, tmp_path / "tape")
    assert content(first)["codes"] == content(second)["codes"]


class Video(Feed):
    """A camera of five frames."""

    CAP_PROP_FRAME_HEIGHT, CAP_PROP_FRAME_WIDTH, CAP_PROP_FPS, CAP_PROP_POS_MSEC = range(4)

    def __init__(self) -> None:
        self._left = 5

    def get(self, what: int) -> float:
        return 60.0 if what == self.CAP_PROP_FPS else 1000 * (5 - self._left) / 60

    def read(self) -> tuple[bool, Any]:
        self._left -= 1
        return (True, np.full((240, 320), self._left, np.uint8)) if self._left >= 0 else (False, None)


def test_a_camera_is_on_the_tape_with_its_frames(tmp_path, monkeypatch):
    settings = OpenCvCamera.Settings(source=0)

    def frames(deck: Any) -> tuple[str, list[tuple[int, float, int]], str]:
        with on_line(deck, "camera"):
            camera = OpenCvCamera.open(settings, VirtualClock())
        camera.start()
        read = [(f.number, f.time, int(f.pixels.sum())) for f in (camera.read() for _ in range(5))]
        error = raises(InstrumentError, "", camera.read)
        camera.close()
        return camera.identity, read, error

    tape = tmp_path / "camera.tape"
    monkeypatch.setattr(opencv, "optional", lambda *_: Video())
    with Recorder(tape) as recorder:
        recorder.begin("{}", None, VirtualClock())
        first = frames(recorder)
    monkeypatch.setattr(opencv, "optional", lambda *_: pytest.fail("a tape needs no OpenCV"))
    player = begun(tape)
    assert frames(player) == first and player.answered == player.calls
    assert [pixels for _, _, pixels in first[1]] == [76_800 * n for n in (4, 3, 2, 1, 0)]


def test_commands_of_a_tape(run, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls = [str(line) for line in lines(whole) if line.get("is") == "call"]
    assert socket.gethostname() not in "".join(calls)
    shown = run("tape", "show", str(whole), "--json")
    found = json.loads(shown.stdout)
    assert (found["rig"], found["on"], found["whole"], found["errors"]) == ("simulated", "wire", True, [])
    assert found["calls"] == sum(found["by_role"].values()) == Player(whole).calls
    assert run("tape", "mask", str(whole), "mail.tape").exit_code == 0
    for words, sentence in (
        (f"tape mask {whole} mail.tape", "exists"),
        ("tape show none.tape", "cannot be read"),
        ("doctor --simulate tape:none.tape", "cannot be read"),
        ("doctor --simulate tape", "is not twin, wire or tape:FILE"),
        ("doctor --simulate tape:", "is not twin, wire or tape:FILE"),
        (f"doctor --simulate tape:{whole} --tape new.tape", "leave out --tape"),
        ("doctor --simulate twin --tape new.tape", "A twin makes no calls"),
        ("demo --tape new.tape", "A twin makes no calls"),
        ("serve --simulate twin --tape new.tape", "A twin makes no calls"),
        ("doctor --tape mail.tape", "exists"),
        ("doctor --tape no/such/folder.tape", "folder"),
        ("log --tape new2.tape", "no option --tape"),
    ):
        ran = run(*words.split())
        assert not Path("new.tape").exists()
        assert ran.exit_code == 2 and sentence.lower() in ran.stderr.lower(), (words, ran.stderr)


def test_a_full_disk_ends_the_tape_only(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path / "full.tape")
    recorder.begin("{}", None, VirtualClock())
    with pytest.raises(DataError, match=r"ends early .no space left.*everything else was done"), recorder:
        line = TapedLine(recorder, "x")
        assert line.call("do", lambda: 1) == 1
        monkeypatch.setattr(recorder._writer, "write", raising(OSError(28, "No space left on device")))
        assert line.call("do", lambda: 2) == 2


@pytest.mark.parametrize("answer", [
    {"got": {"a": ["<f8", [2], "AAAA"]}},
    {"got": {"a": ["|O", [1], "AAAAAAAAAAA="]}},
    {"got": {"x": 1}},
    {"filled": [{"a": ["<f8", [3], "AAAAAAAAAAA="]}], "got": None},
    {"error": ["ConnectionError", 5]},
    {"error": 3},
    {},
])  # fmt: skip
def test_an_answer_that_cannot_be_read_is_one_sentence(answer, tmp_path):
    """Of a tape whose hashes are right: somebody else's."""
    tape = tmp_path / "odd.tape"
    writer = TapeWriter(tape)
    writer.write({"format": "haploop tape", "version": 1, "software": "x", "started": "x"})
    writer.write({"is": "rig", "mode": None, "real": False, "at": 0.0, "rig": "{}"})
    writer.write({"is": "thread", "thread": 0, "name": "MainThread"})
    call = {"is": "call", "n": 1, "thread": 0, "at": 0.0, "role": "x", "do": "do", "with": []}
    writer.write({**call, **answer})
    writer.write({"is": "end", "lines": 4})
    writer.close()
    given = {"filled": (np.zeros(2),), "failures": (Failure(ConnectionError),)}
    with pytest.raises(TapeError, match=r"answer to call 1 on the tape .* cannot be read"):
        TapedLine(begun(tape), "x").call("do", lambda: None, **given)


@pytest.mark.night
def test_a_demo_leaves_a_tape(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = run("demo", "--out", "out", "--simulate", "wire", "--tape", "day.tape", "--json")
    assert json.loads(ran.stdout)["mode"] == "wire"
    with Player(Path("day.tape")) as player:
        assert player.whole and player.calls > 100
