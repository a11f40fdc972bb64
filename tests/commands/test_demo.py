import html
import json
import math
import re
import shlex
import shutil
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from haploop.acquisition import Recording
from haploop.base.errors import ConfigurationError
from haploop.calibration.drive import Offer, Offers
from haploop.commands.demo import run as run_module
from haploop.commands.demo.report import demo_contents
from haploop.commands.demo.run import _patches
from haploop.instruments import open_rig
from tests.documents.pages import ROOT, blocks


def numbers(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [n for item in value.values() for n in numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [value] if isinstance(value, float | int) else []


def test_every_button_passes_and_the_exit_code_says_so(demo):
    assert {name: (b["passed"], b["reasons"]) for name, b in demo.summary["buttons"].items()} == {
        "latch": (True, []),
        "toggle": (True, []),
        "push": (True, []),
    }
    assert demo.summary["passed"] is True
    assert demo.result.exit_code == 0


def test_what_is_measured_agrees_with_the_plant(demo):
    buttons = demo.summary["buttons"]
    for button in buttons.values():
        assert button["presses"] == button["presses_detected"] == 10
        assert button["activation_force_n"] == pytest.approx(button["activation_force_true_n"], rel=0.02)
        assert 0 < button["drive_peak_v"] <= 50
        assert button["drive_peak_to_peak_v"] <= 100
        assert button["within"]["error"] <= button["tolerance"]
        assert button["correlation"] >= 0.97
    force = {name: button["activation_force_n"] for name, button in buttons.items()}
    assert force["latch"] > force["push"] > force["toggle"]
    assert demo.summary["resonance_hz"] == pytest.approx(demo.summary["resonance_true_hz"], abs=0.3)


def test_the_summary_says_what_the_run_was(demo, mode):
    summary = demo.summary
    assert summary["simulated"] is True
    assert summary["mode"] == (mode if mode in ("twin", "wire") else "twin")
    assert (summary["rig"], summary["seed"]) == ("simulated", 0)
    assert summary["simulated_s"] > 30
    assert summary["wall_s"] > 0
    assert 0 <= summary["coherence_min_in_band"] <= 1
    assert all(math.isfinite(n) for n in numbers(summary))
    assert json.loads((demo.folder / "summary.json").read_text(encoding="utf-8")) == summary


def test_recordings_are_kept_with_the_hash_that_the_summary_names(demo):
    for button in demo.summary["buttons"].values():
        (source,) = button["sources"]
        recording = Recording.open(demo.folder / "recordings" / source["file"])
        assert recording.complete and recording.simulated
        assert recording.content_hash == source["sha256"]


@pytest.mark.long
def test_the_report_names_the_command_that_writes_its_figures(demo, run, tmp_path):
    report = (demo.folder / "report.html").read_text(encoding="utf-8")
    (command,) = re.findall(r"<code>haploop (figures .*) --out figures</code>", report)
    run(*shlex.split(html.unescape(command)), "--out", tmp_path / "figures", ends=0)
    written = {path.name for path in (tmp_path / "figures").iterdir()}
    names = ("presses", "forces", "drives", "response", "check", "motion", "feeling")
    assert written >= {f"{name}.{kind}" for name in names for kind in ("svg", "csv")}


def test_the_report_stands_alone(demo):
    report = (demo.folder / "report.html").read_text(encoding="utf-8")
    assert demo.summary["report"] == str(demo.folder / "report.html")
    assert not re.search(r'(?:src|href)="(?!data:)', report)
    assert not re.search(r"https?://|url\(|@import", report)
    assert "data:image" not in report  # figures are drawn where somebody asks for them
    assert "Everything here is simulated" in report
    for button in demo.summary["buttons"].values():
        assert button["sources"][0]["sha256"] in report


@pytest.mark.long
def test_figures_are_drawn_with_the_true_values_where_they_are_asked_for(run, tmp_path):
    assert run("demo", "--out", tmp_path / "drawn", "--figures").exit_code == 0
    report = (tmp_path / "drawn" / "report.html").read_text(encoding="utf-8")
    assert report.count('src="data:image/svg+xml;base64,') == 6
    assert "Dashed: the true response of the plant" in report


@pytest.mark.long
def test_a_demo_loads_nothing_that_draws_and_no_statistics(tmp_path):
    script = (
        "import sys; from haploop.commands.demo.run import run_demo; run_demo(sys.argv[1]);"
        "print(sorted({'matplotlib', 'scipy.signal', 'scipy.stats'} & set(sys.modules)))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=False
    )
    assert ended.stdout == "[]\n", ended.stderr


def test_each_button_says_in_one_sentence_who_feels_it_and_what_would_settle_it(demo):
    said = "\n".join(demo_contents(demo.summary).notes)
    for name, button in demo.summary["buttons"].items():
        assert f"{name.capitalize()}: {button['feeling']['sentence']}" in said
        assert re.search(r"(feels? it|feel it) \(\d+ dB (above|below) threshold; .* of people\)", said)
    assert said.count("A threshold experiment of this lab settles it.") == 1
    # The plant's strength is an estimate as well, and the answer moves with it.
    acts = [b["feeling"]["acts"]["pressing"] for b in demo.summary["buttons"].values()]
    needed = max(one["higher_db"] - one["above_threshold_db"] for one in acts)
    times = re.search(r"with ([\d.]+) times that or more all these buttons would be felt", said)
    assert times and float(times[1]) == pytest.approx(10 ** (needed / 20), rel=0.05)


def test_a_second_demo_overwrites_nothing(demo, run):
    before = (demo.folder / "summary.json").read_bytes()
    run("demo --out", demo.folder, says="not overwritten")
    assert (demo.folder / "summary.json").read_bytes() == before


def test_the_scripts_of_the_documents_compute_a_demo_again(demo, tmp_path, monkeypatch, capsys):
    """Error, floor, interval, verdict and response, from the files of its folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("calibration.h5", "calibration-waveforms.h5"):
        shutil.copy(demo.folder / name, name)
    (tmp_path / "checked").mkdir()
    shutil.copy(demo.folder / "checks" / "push.h5", "checked/push-check.h5")
    for block in blocks((ROOT / "docs" / "explanation" / "check.md").read_text(encoding="utf-8")):
        if block.language == "python":
            exec(compile(block.text, f"line {block.line} of check.md", "exec"), {})
    printed = capsys.readouterr().out
    push = demo.summary["buttons"]["push"]
    low, high = push["whole"]["interval"]
    error, floor = push["whole"]["error"], push["whole"]["floor"]
    assert printed.startswith(f"{error:.4f} ({low:.4f} to {high:.4f}), floor {floor:.4f}, pass: True")
    off = re.search(r"at ([\d.]+) Hz; ([\d.]+)% from the stored one", printed)
    assert off and float(off[2]) < 2
    assert float(off[1]) == pytest.approx(demo.summary["resonance_hz"], abs=1)
    assert (demo.folder / "calibration-waveforms.h5").stat().st_size < 10e6


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("recordings/P01-latch.h5", "recording"),
        ("presses/latch.h5", "representative"),
        ("calibration.h5", "calibration"),
        ("drives/latch.h5", "drive"),
    ],
)
def test_show_knows_every_file_of_a_demo(demo, run, tmp_path, name, kind):
    plot = tmp_path / "plot.png"
    values = run.json("show", demo.folder / name, "--plot", plot)
    assert values["kind"] == kind
    assert values["simulated"] is True
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "Simulated" in run("show", demo.folder / name).stdout


def test_check_finds_what_the_demo_found(demo, run, tmp_path):
    values = run.json(
        "check", demo.folder / "recordings" / "P01-toggle.h5", "--calibration",
        demo.folder / "calibration.h5", "--out", tmp_path,
    )  # fmt: skip
    assert values["button"] == "toggle"
    assert values["passed"] is True
    assert values["drive_peak_v"] == pytest.approx(
        demo.summary["buttons"]["toggle"]["drive_peak_v"], rel=0.05
    )


def test_a_picture_takes_no_file_s_place(demo, run, tmp_path):
    recording = demo.folder / "recordings" / "P01-latch.h5"
    before = recording.read_bytes()
    run("show", recording, "--plot", recording, ends=2)
    there = tmp_path / "there.png"
    there.write_text("mine")
    run("show", recording, "--plot", there, ends=2)
    run("show", recording, "--plot", tmp_path / "picture.xyz", ends=2)
    assert recording.read_bytes() == before and there.read_text() == "mine"


def test_the_patches_that_play_are_those_with_a_channel_of_their_own():
    for name, asked, played in (("simulated", None, ("A",)), ("four-channel", None, ("A", "B", "C", "D")),
        ("four-channel", ("C",), ("C",))):  # fmt: skip
        with open_rig(name, simulate="twin") as rig:
            assert _patches(rig, asked) == played
            with pytest.raises(ConfigurationError, match="has no patch 'X'"):
                _patches(rig, ("A", "X"))


@pytest.mark.parametrize(
    ("levels", "method"),
    [
        ({"modulated": 8.0, "broadband": 12.0}, "modulated"),
        ({"modulated": 6.5, "broadband": 8.0}, "broadband"),
        ({"modulated": 4.0, "broadband": 3.0}, "modulated"),
    ],
)
def test_several_patches_play_on_the_carrier_unless_only_the_press_itself_is_felt(
    monkeypatch, levels, method
):
    def offer(drives, lab):
        [made] = drives
        return Offers(made.method, "A, B", 0.6, (Offer(0.07, 0.07, levels[made.method], 0.4, 48.0),))

    monkeypatch.setattr(run_module, "drive_for", lambda *_, method, trade: SimpleNamespace(method=method))
    monkeypatch.setattr(run_module, "offered", offer)
    monkeypatch.setattr(run_module, "lab_threshold", lambda rig: None)
    rig: Any = SimpleNamespace(limits=None)
    press: Any = None
    assert run_module._loud(press, [], rig).method == method


def test_four_patches_are_felt_at_8_percent_of_error_and_say_so(request, run, tmp_path):
    if not request.config.getoption("--full"):
        pytest.skip("calibrates four patches: runs with --full")
    result = run("demo --rig four-channel --out", tmp_path / "four", "--json")
    summary = json.loads(result.stdout)
    assert result.exit_code == 0 and summary["patch"] == "A, B, C, D"
    for button in summary["buttons"].values():
        assert button["whole"]["interval"][1] <= 0.08 and button["feeling"]["felt"] == "yes"
        assert button["feeling"]["sentence"].startswith("A person who presses with ")
