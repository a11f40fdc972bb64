"""`haploop report`: what is read, what is said of it, and that nothing changes when it is made again."""

import re
import shutil
from contextlib import nullcontext
from pathlib import Path

import pytest

from haploop.reports.contents import unbroken
from haploop.reports.html import report_html, write_report
from tests.command_line import Demo


@pytest.fixture(scope="module")
def made(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("report")
    paths = [demo.folder / "recordings" / "P01-latch.h5", demo.folder / "calibration.h5"]
    for name in ("once", "again"):
        write_report(paths, place / name / "all.html")
    return place


@pytest.mark.long
def test_a_report_needs_no_other_file_and_says_what_is_simulated(made, demo):
    page = (made / "once" / "all.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src="(?!data:)|href="(?!all-figures/))', page)
    assert not re.search(r"<script|@import|url\(", page)
    assert page.count('src="data:image/svg+xml;base64,') == 3
    assert "Simulated." in page and "Everything here is simulated." in page
    sha256 = demo.summary["buttons"]["latch"]["sources"][0]["sha256"]
    assert sha256 in page
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page, re.S)
    assert all("n = " in caption and "SHA-256" in caption and "Simulated." in caption for caption in captions)
    assert "latch, n = 10 presses by 1 participant" in captions[0].lower()
    assert ">stable</td>" in page and "10 presses accepted, 0 not" in page


@pytest.mark.long
def test_a_report_made_again_is_the_same_bytes(made):
    once = sorted(path.relative_to(made / "once") for path in (made / "once").rglob("*") if path.is_file())
    again = sorted(path.relative_to(made / "again") for path in (made / "again").rglob("*") if path.is_file())
    assert once == again and len(once) == 1 + 3 * 3
    for path in once:
        assert (made / "once" / path).read_bytes() == (made / "again" / path).read_bytes(), path


def test_its_figures_are_there_as_pictures_and_numbers(made):
    folder = made / "once" / "all-figures"
    names = ["01-forces", "02-pressed", "03-response"]
    assert sorted(p.name for p in folder.iterdir()) == [
        f"{n}.{k}" for n in names for k in ("csv", "pdf", "svg")
    ]
    assert b"simulated" in (folder / "03-response.svg").read_bytes()
    head, first = (folder / "03-response.csv").read_text("utf-8").splitlines()[:2]
    assert head == "panel,curve,x axis,y axis,x,y,value"
    assert first.startswith(
        "a Patch A to the button point,Measured,Frequency (Hz),Velocity per volt (µm/s/V),2"
    )
    linked = re.findall(r'href="(all-figures/[^"]+)"', (made / "once" / "all.html").read_text("utf-8"))
    assert sorted(linked) == [f"all-figures/{n}.{k}" for n in names for k in ("csv", "pdf", "svg")]
    pdf = (folder / "03-response.pdf").read_bytes()
    assert pdf.startswith(b"%PDF") and b"/Type3" not in pdf and b"CreationDate" not in pdf


@pytest.mark.long
def test_a_study_s_report_describes_its_participants_and_takes_names_for_text(run, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(
        'name = "<script>alert(1)</script>"\nrig = "simulated"\nbuttons = ["push"]\npresses = 2\n'
        'participants = ["P01", "P02"]\n[participant.P01]\nage = 20\nsex = "<b>f"\n'
        '[participant.P02]\nage = 31\nsex = "m"\n',
        encoding="utf-8",
    )
    early = run("report", study, "-o", tmp_path / "early.html")
    assert early.exit_code == 0 and "<script" not in (tmp_path / "early.html").read_text(encoding="utf-8")
    run("study run -s", study, ends=0)
    values = run.json("report", study, "-o", tmp_path / "a.html")
    assert values["simulated"] and len(values["figures"]) == 6
    assert [v["said"] for v in values["verdicts"]] == ["complete", "complete"]
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<script" not in page and "<b>f" not in page
    assert "20 to 31, mean 25.5, standard deviation 7.8 (n = 2)" in page
    assert "&lt;b&gt;f: 1, m: 1" in page
    shown = run.json("show", tmp_path / "recordings" / "P01-push.h5")
    assert shown["participant_columns"] == {"age": 20, "sex": "<b>f"}
    run("report", study, "-o", tmp_path / "a.html", says="exists")
    run("report", tmp_path / "recordings", "-o", tmp_path / "within.html", ends=0)
    linked = (tmp_path / "within.html").read_bytes().replace(b'"within-figures/', b'"a-figures/')
    assert linked == (tmp_path / "a.html").read_bytes()


@pytest.mark.long
def test_what_several_files_show_alike_is_one_figure_and_drawn_once(demo, tmp_path):
    again = Path(shutil.copy(demo.folder / "calibration.h5", tmp_path / "again.h5"))
    presses = [demo.folder / "presses" / f"{name}.h5" for name in ("latch", "push")]
    made = write_report([demo.folder / "calibration.h5", again, *presses, presses[0]], tmp_path / "a.html")
    assert [p.name for p in made.figures if p.suffix == ".svg"] == ["01-presses.svg", "02-response.svg"]
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    caption = page.split("<figcaption>")[1]
    assert caption.count("n = 10 presses") == 2 and "latch.h5" in caption and "push.h5" in caption


@pytest.mark.long
def test_a_copy_of_a_file_counts_once(demo, tmp_path):
    one = demo.folder / "recordings" / "P01-latch.h5"
    write_report([one, Path(shutil.copy(one, tmp_path / "copy.h5"))], tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "n = 10 presses by 1 participant" in page and "n = 20" not in page


def test_a_folder_of_files_is_reported_and_shown_and_any_other_refused(demo, run, tmp_path):
    run("report", demo.folder / "presses", "-o", tmp_path / "presses.html", "--json", ends=0)
    page = (tmp_path / "presses.html").read_text(encoding="utf-8")
    assert all(f"{name}.h5" in page for name in ("latch", "push", "toggle"))
    assert "P01" in run("show", demo.folder / "recordings").stdout
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "experiment.toml").touch()
    (tmp_path / "empty").mkdir()
    report, show = ("report", "-o", tmp_path / "x.html"), ("show",)
    for command, path, said in ((report, "mine", "the key 'name' is missing"),
        (show, "mine", "`haploop experiment export"), (report, "empty", "neither a study"),
        (show, "empty", "neither a study")):  # fmt: skip
        run(*command, tmp_path / path, says=said)
    run("show", *sorted((demo.folder / "presses").glob("*.h5")), says="holds a representative")


def test_what_cannot_be_reported_is_one_sentence(run, demo, tmp_path):
    calibration = demo.folder / "calibration.h5"
    run("report", calibration, "-o", tmp_path / "a.pdf", says=".html")
    wrong = run("report", tmp_path / "nothing.h5", "-o", tmp_path / "a.html")
    assert wrong.exit_code == 2 and wrong.stderr.count("Error") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_the_first_screen_answers_like_felt_and_loud_in_three_lines(demo, tmp_path):
    made = write_report(demo.folder / "checks" / "latch.h5", tmp_path / "report.html")
    of_latch = next(one for one in made.verdicts if "latch" in one.subject and "error" in one.measured)
    felt, part = of_latch.answers
    assert re.fullmatch(
        r"Not known whether a person who presses feels it \(\d+ dB below .* of people\)", felt
    )
    assert re.fullmatch(r"plays \d+\.\d % of the press's energy, at 0\.\d{3} of its size", part)
    page = made.html.read_text(encoding="utf-8")
    assert "20\N{NO-BREAK SPACE}%" in page and not re.search(r"\d%[^\";]", page.split("</style>")[1])


@pytest.mark.long
def test_a_report_opens_with_a_glance_of_each_button_and_folds_the_rest(demo, tmp_path):
    names = ("latch", "toggle", "push")
    checks = [demo.folder / "checks" / f"{name}.h5" for name in names]
    page = write_report(checks, tmp_path / "report.html").html.read_text(encoding="utf-8")
    first, *folded = re.split("<details[^>]*>", page.split("</style>")[1])
    assert re.findall(r"<h2><span>(\w+)</span><span class=\"good\">pass</span></h2>", first) == [
        name.capitalize() for name in names
    ]
    assert first.count('<path class="measured"') == first.count('class="gauge"') / 3 == 3
    for name in names:
        low, high = (100 * edge for edge in demo.summary["buttons"][name]["whole"]["interval"])
        assert f"({low:.1f} to {high:.1f}\N{NO-BREAK SPACE}%)" in first
    sentences = re.findall(r"<p>(.*?)</p>", first)
    assert len(sentences) == 3 and all(len(one.split()) <= 20 for one in sentences)
    assert len(folded) >= 3 and not re.search("<details[^>]* open>", page)
    (table,) = re.findall(r"<thead><tr><td></td>(.*?)</tr>", page)
    assert table.count("<th>") == 3


def test_numbers_stay_with_their_units_and_nothing_else_is_joined():
    nb = "\N{NO-BREAK SPACE}"
    assert unbroken("20% at 263.5 Hz, 3 of 4 V") == f"20{nb}% at 263.5{nb}Hz, 3 of 4{nb}V"
    assert unbroken("press 3 is good; 5 Ships, 2 stays") == "press 3 is good; 5 Ships, 2 stays"


def test_a_result_without_a_figure_names_no_command_that_would_draw_it(demo):
    page = report_html(demo.folder / "calibration-waveforms.h5", nullcontext()).decode("utf-8")
    assert "haploop figures" not in page and "<summary>Figures" not in page
