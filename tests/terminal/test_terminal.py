"""What an operator sees at a terminal of 80 columns, and in a notebook."""

import builtins
import io
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console as Screen

from haploop.acquisition import (
    Protocol,
    Recording,
    Representative,
    load_study,
    record,
    run_study,
)
from haploop.base.errors import InstrumentError
from haploop.calibration import Calibration, Check, Drive
from haploop.instruments import Consent, Rest, open_rig
from haploop.instruments.operator import console
from haploop.reports.show import Meter, StudyMeter
from haploop.terminal import progress

SENTENCE = "The button did not switch, and the force was beyond what the sensor can take; it is repeated now."


def screen(**more: object) -> Screen:
    return Screen(file=io.StringIO(), width=80, height=24, **more)


def test_a_sentence_stands_above_what_is_shown_and_is_broken_between_words():
    shown = screen(force_terminal=True, color_system=None)
    with progress.shown(shown):
        progress.note(SENTENCE)
    lines = shown.file.getvalue().splitlines()
    assert len(lines) == 2 and " ".join(line.strip() for line in lines) == SENTENCE
    progress.note(SENTENCE)  # elsewhere, once nothing is shown
    assert len(shown.file.getvalue().splitlines()) == 2


def test_a_meter_counts_measures_and_counts_down(tmp_path):
    shown = screen(force_terminal=True, color_system=None)
    seen: list[str] = []
    with open_rig("simulated", simulate="twin") as rig:
        meter = Meter(rig, shown)

        def look(*_told):
            with shown.capture() as captured:
                shown.print(meter.lines())
            seen.append(captured.get())

        tell = rig.operator.tell
        rig.operator.tell = lambda request: (tell(request), look())[0]
        record(
            rig, "latch", "P01", 2, tmp_path, progress=lambda *p: (meter.progress(*p), look()),
            on_verdict=lambda press: (meter.on_verdict(press), look()),
            protocol=Protocol(wait=60), on_request=meter.on_request,
        )  # fmt: skip
        meter.lines()
        look()
    text = "\n".join(seen)
    assert "0 of 2" in text and "2 of 2" in text and "Done." in seen[-1]
    forces = [float(line.split(" N")[0].split()[-1]) for line in text.splitlines() if " N " in line]
    assert max(forces) > 5  # the latch: 7.5 N at its activation
    assert max(map(len, text.splitlines())) <= 80


def test_a_meter_says_nothing_is_done_before_the_first_block():
    shown = screen(force_terminal=True, color_system=None)
    with open_rig("simulated", simulate="twin") as rig:
        meter = Meter(rig, shown)
        meter.on_request(Rest(1.0))
        with shown.capture() as captured:
            shown.print(meter.lines())
    assert captured.get().startswith("Starting.")


def test_a_meter_is_plain_lines_where_there_is_no_terminal(tmp_path):
    shown = screen()
    with open_rig("simulated", simulate="twin") as rig, Meter(rig, shown) as meter:
        record(rig, "push", "P01", 2, tmp_path, progress=meter.progress, on_verdict=meter.on_verdict)
    said = shown.file.getvalue()
    assert said == "Record the push button: 0 of 2 presses.\n1 of 2 presses.\n2 of 2 presses.\n"


def test_a_studys_meter_counts_in_all_and_is_away_while_a_question_is_asked(tmp_path):
    text = 'name = "pilot"\nbuttons = ["toggle", "push"]\nparticipants = ["P01"]\npresses = 2\n'
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    study, shown = load_study(tmp_path), screen(force_terminal=True, color_system=None)
    asked: list[tuple[str, int]] = []
    lines: list[str] = []
    with open_rig("simulated", simulate="twin") as rig, StudyMeter(rig, study.progress(), shown) as meter:
        confirm = rig.operator.confirm

        def answer(request):
            asked.append((type(request).__name__, len(progress._shown)))
            return confirm(request)

        def verdict(participant, button, press):
            asked.append(("Verdict", len(progress._shown)))
            with shown.capture() as captured:
                shown.print(meter.lines())
            lines.append(captured.get())
            meter.on_study_verdict(participant, button, press)

        rig.operator.confirm = answer
        assert run_study(rig, study, progress=meter.progress, on_verdict=verdict, on_request=meter.on_request)
    told = {one for one in asked if one[0] in ("Consent", "Ready", "Verdict")}
    assert told == {("Consent", 0), ("Ready", 0), ("Verdict", 1)}
    assert "P01, push: 1 of 2; 3 of 4 in all. Press 2" in "\n".join(lines)
    assert max(len(line) for one in lines for line in one.splitlines()) <= 80
    said = shown.file.getvalue()
    assert "P01, toggle: 2 of 2 presses." in said and not progress._shown


def test_a_question_is_asked_in_a_cell(monkeypatch):
    asked: list[str] = []
    operator = console.Console()
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(InstrumentError, match="Nobody is at the console"):
        operator.confirm(Consent("P01"))
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setattr(builtins, "input", lambda prompt: asked.append(prompt) or "n")
    assert not operator.confirm(Consent("P01"))
    assert asked == ["Has P01 read and signed the consent form? [y/n] "]


@pytest.mark.long
def test_values_are_short_and_a_notebook_shows_a_picture(demo):
    folder = demo.folder
    values = (
        Recording.open(folder / "recordings" / "P01-latch.h5"),
        Representative.load(folder / "presses" / "latch.h5"),
        Calibration.load(folder / "calibration.h5"),
        Drive.load(folder / "drives" / "latch.h5"),
        Check.load(folder / "checks" / "latch.h5"),
    )
    for value in values:
        assert len(repr(value)) < 120 and "simulated" in repr(value)
        html = value._repr_html_()
        assert html.count('src="data:image/png;base64,') == 1 and "<table>" in html
    assert "20 to 620 Hz, " in repr(values[2].response) and len(repr(values[2].response)) < 120
    assert "263." in repr(values[2].model) and len(repr(values[2].model)) < 160
    with open_rig("simulated", simulate="twin") as rig:
        assert "open, simulated by its twin; daq" in repr(rig)
        html = rig._repr_html_()
    assert "vibrometer" in html and "simulated" in html and "<svg" in html


FAULT = """
base = "simulated"
[[simulation.faults]]
kind = "sensor-saturated"
channel = "acceleration_z"
within = 1
times = 2
every = 2
duration = 0.2
"""
STUDY = """
name = "pilot"
rig = "rig.toml"
buttons = ["toggle"]
participants = ["P01"]
presses = 3
"""


def run_in_a_terminal(folder: Path, *words: str) -> str:
    """What a command writes at a terminal of 80 columns of its own."""
    pty, termios = pytest.importorskip("pty"), pytest.importorskip("termios")
    pid, terminal = pty.fork()
    if pid == 0:
        termios.tcsetwinsize(0, (24, 80))
        environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR")}
        environment |= {"TERM": "xterm-256color", "HAPLOOP_STATE": str(folder / "state")}
        os.chdir(folder)
        os.execve(sys.executable, [sys.executable, "-m", "haploop", *words], environment)
    written = b""
    try:
        while part := os.read(terminal, 65536):
            written += part
    except OSError:  # how Linux says that the other side has closed
        pass
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, written.decode()
    return written.decode()


def drawn(written: str) -> tuple[list[str], list[str]]:
    """The lines that a terminal shows at the end, and every line that stood on it before it was erased."""
    screen, row, column, erased = [""], 0, 0, []
    for code, text in re.findall(r"(\x1b\[[?0-9;]*[A-Za-z]|[\r\n])|([^\x1b\r\n]+)", written):
        if text:
            screen[row] = screen[row][:column].ljust(column) + text + screen[row][column + len(text) :]
            column += len(text)
        elif code == "\r":
            column = 0
        elif code == "\n":
            row += 1
            screen += [""] * (row == len(screen))
        elif code.endswith("A"):
            row -= int(code[2:-1] or 1)
        elif code.endswith("K"):
            erased.append(screen[row])
            screen[row] = ""
        else:
            assert code[-1] in "mhl", code  # colours; the cursor is hidden and shown
    return screen, erased


@pytest.mark.long
def test_at_a_terminal_sentences_and_meter_never_share_a_line(tmp_path):
    """`haploop study run` at a terminal of its own, with a press that is refused meanwhile."""
    (tmp_path / "rig.toml").write_text(FAULT, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    screen, erased = drawn(run_in_a_terminal(tmp_path, "study", "run"))
    assert max(map(len, screen + erased)) <= 80
    refused = r"P01, toggle: Press 1, attempt \d: [^.]+\.[^.]*\.? It is kept and will be repeated\."
    assert re.search(refused, " ".join(line.strip() for line in screen))
    assert not any("░" in line for line in screen), "the meter is taken away at the end"
    bars = [line for line in erased if "░" in line or "█" in line]
    meter = r"Force [█░]{10} +[\d.]+ N  Acceleration [█░]{10} +[\d.]+ m/s²(  OVERLOAD)?"
    assert bars and all(re.fullmatch(meter, line) for line in bars)
    counts = [line for line in erased if line and line not in bars]
    assert counts and all(re.match(r"P01, toggle: [0-3] of 3|Starting\.$", line) for line in counts)
