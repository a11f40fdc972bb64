"""Tables III and IV of the paper, from the matrices behind them, and what is not defined."""

from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.experiments.analysis.identification import (
    METRICS,
    analyse_identification,
    clustered_interval,
    confusion_of,
    confusions_by,
    wilson_interval,
)
from haploop.experiments.analysis.table import read_rows

BUTTONS = ("latch", "toggle", "push")
MATRICES = {
    ("I", "1"): [[75, 15, 10], [18, 67, 15], [9, 23, 68]],
    ("I", "2"): [[92, 3, 5], [3, 83, 14], [7, 14, 79]],
    ("II", "1"): [[95, 3, 2], [3, 83, 14], [1, 18, 81]],
    ("II", "2"): [[100, 0, 0], [0, 87, 13], [0, 10, 90]],
}
"""By group and day. The tables do not fix all cells beside the diagonal: each of these is one solution."""

TABLES = {
    ("I", "1"): ([82.67, 76.33, 81.00], [73.53, 63.81, 73.12], [75, 67, 68]),
    ("I", "2"): ([94.00, 88.67, 86.67], [90.20, 83.0, 80.61], [92, 83, 79]),
    ("II", "1"): ([97.00, 87.33, 88.33], [95.96, 79.81, 83.51], [95, 83, 81]),
    ("II", "2"): ([100, 92.33, 92.33], [100, 89.69, 87.38], [100, 87, 90]),
}
"""Tables III and IV: accuracy, precision and sensitivity (%) of latch, toggle and push."""

OVERALL = {("I", "1"): 70.00, ("I", "2"): 84.67, ("II", "1"): 86.33, ("II", "2"): 92.33}


def paper_csv(folder: Path) -> Path:
    lines = ["group,day,presented,answered,count"]
    for (group, day), matrix in MATRICES.items():
        for presented, row in zip(BUTTONS, matrix, strict=True):
            lines += [f"{group},{day},{presented},{a},{n}" for a, n in zip(BUTTONS, row, strict=True)]
    path = folder / "paper.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def written(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_published_cell(tmp_path):
    rows = read_rows(paper_csv(tmp_path))
    by_session = confusions_by(rows, "group", "day")
    assert by_session.keys() == TABLES.keys()
    for key, confusion in by_session.items():
        assert confusion.classes == BUTTONS
        for metric, published in zip(METRICS, TABLES[key], strict=True):
            for button, percent in zip(BUTTONS, published, strict=True):
                value = confusion.value(metric, button)
                assert value is not None
                assert round(100 * value, 2) == pytest.approx(percent), (key, metric, button)
        assert round(100 * confusion.overall, 2) == pytest.approx(OVERALL[key])
    assert round(100 * confusion_of(rows).overall) == 83


def test_never_answered_is_not_defined(tmp_path):
    text = "presented,answered\nlatch,latch\nlatch,toggle\npush,toggle\npush,latch\n"
    confusion = confusion_of(read_rows(written(tmp_path, text)))
    assert confusion.classes == ("latch", "push", "toggle")
    assert confusion.value("precision", "push") is None and confusion.interval("precision", "push") is None
    assert confusion.value("sensitivity", "push") == 0
    assert confusion.value("sensitivity", "toggle") is None
    assert confusion.value("precision", "toggle") == 0
    assert confusion.value("accuracy", "toggle") == 0.5


@pytest.mark.parametrize(
    ("sidecar", "classes", "groups"),
    [
        ("", ("push", "latch", "toggle", "none"), ("II", "I")),
        ('{"presented": {"Levels": ["latch", "toggle", "push", "rest"]}, '
         '"answered": {"Levels": ["none"]}, "Seed": 1, '
         '"group": {"Levels": {"I": "first", "II": "second"}}}', ("latch", "toggle", "push", "none"),
         ("I", "II")),
        ('{"presented": {"Levels": 3}, "group": []}', ("push", "latch", "toggle", "none"), ("II", "I")),
        ("[[[", ("push", "latch", "toggle", "none"), ("II", "I")),
    ],
)  # fmt: skip
def test_classes_are_in_the_order_that_the_sidecar_states(tmp_path, sidecar, classes, groups):
    """Without one that can be read, in the order of the table."""
    (tmp_path / "table.json").write_text(sidecar, encoding="utf-8")
    text = "group,presented,answered\nII,push,latch\nII,latch,push\nI,toggle,toggle\nI,latch,none\n"
    rows = read_rows(written(tmp_path, text))
    by_group = confusions_by(rows, "group")
    assert [key for (key,) in by_group] == list(groups)
    for confusion in (confusion_of(rows), *by_group.values()):
        assert confusion.classes == classes
    assert by_group["II",].value("sensitivity", "latch") == 0
    assert by_group["I",].value("sensitivity", "toggle") == 1


def test_a_table_that_a_spreadsheet_with_decimal_commas_saved_is_read(tmp_path):
    text = "\ufeffsep=;\r\nvalue;correct;simulated\r\n1,5;WAHR;FALSCH\r\n2;FALSCH;FALSCH\r\n"
    rows = read_rows(written(tmp_path, text))
    assert rows.numbers("value") == [1.5, 2.0]
    assert rows.truths("correct") == [True, False]
    assert not rows.simulated
    assert read_rows(written(tmp_path, text.replace("2;FALSCH;FALSCH", "2;FALSCH;WAHR"))).simulated
    assert read_rows(written(tmp_path, "simulated,x\nTRUE,1\n")).simulated
    text = "\ufeffpresented;answered;count\nlatch;latch;3\n# a remark\nlatch;push;1\n"
    assert confusion_of(read_rows(written(tmp_path, text))).overall == 0.75


@pytest.mark.parametrize(
    "text", ["value;x\n1.500;a\n2,5;a\n", 'value,x\n"1,5",a\n', "value;x\n1.500,5;a\n", "value;x\n1,2,3;a\n"]
)
def test_a_number_that_may_be_two_is_refused(tmp_path, text):
    with pytest.raises(DataError, match="write all numbers with a decimal point"):
        read_rows(written(tmp_path, text)).numbers("value")


def test_what_is_not_defined_and_groups_that_differ_are_said(tmp_path):
    people = [f"P{k},{'I' if k < 4 else 'II'},1" for k in range(1, 6)]
    lines = [f"{who},{p},{a}" for who in people for p, a in (("a", "a"), ("b", "a"), ("a", "a"), ("b", "a"))]
    text = "\n".join(["participant,group,day,presented,answered", *lines])
    result = analyse_identification(read_rows(written(tmp_path, text)))
    notes = " ".join(result.notes)
    assert "Not defined, group I, day 1: the precision of b, which was never answered." in notes
    assert "The groups differ in size (I 3, II 2 participants)" in notes


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("presented,answered,count\n", "no line below"),
        ("presented,answer\na,b\n", "no column 'answered'"),
        ("presented,answered,count\na,b,1.5\n", "line 2: count is 1.5"),
        ("presented,answered,count\na,b,-1\n", "line 2: count is -1"),
        ("presented,answered,count\na,b,many\n", "line 2: count is 'many'"),
        ("presented,answered,count\na,b,nan\n", "not a number"),
        ("presented,answered,count\na,,1\n", "'answered' is empty"),
        ("presented,answered,count\na,b\n", "line 2 has 2 cells"),
        ("presented,answered,count\na,b,0\n", "counts no trial"),
        ("presented,presented,count\na,b,1\n", "each column once"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, text, said):
    with pytest.raises(DataError, match=said):
        confusion_of(read_rows(written(tmp_path, text)))


def covered(people: int, trials: int, spread: float, rng: np.random.Generator) -> float:
    """Fraction of 200 simulated experiments whose interval covers the mean over all people."""
    logit = rng.normal(1.2, spread, size=200_000)
    truth = float(np.mean(1 / (1 + np.exp(-logit))))
    inside = 0
    for _ in range(200):
        p = 1 / (1 + np.exp(-rng.normal(1.2, spread, size=people)))
        interval = clustered_interval(rng.binomial(trials, p), [trials] * people)
        inside += interval[0] <= truth <= interval[1]
    return inside / 200


def test_intervals_over_people_cover_what_they_say():
    """The nominal 95 %, where independent trials would cover 60 %; never far below it."""
    rng = np.random.default_rng(5)
    for people, spread in ((10, 1.0), (20, 1.0), (10, 0.0)):
        assert 0.91 <= covered(people, 30, spread, rng) <= 0.995, (people, spread)


def test_an_interval_of_people_is_not_shorter_than_that_of_trials():
    alike = clustered_interval([9] * 10, [10] * 10)
    trials = wilson_interval(90, 100)
    assert alike and trials and alike[0] <= trials[0] and alike[1] >= trials[1]
    assert clustered_interval([10, 10], [10, 10]) is not None
    assert clustered_interval([10], [10]) is None
