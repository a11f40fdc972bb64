"""An experiment or a study that is made in a form: its file, its preview, and what is refused."""

import json

import pytest

from haploop.acquisition import load_study
from haploop.base.errors import ConfigurationError
from haploop.experiments import example_names, load_experiment
from tests.console.test_experiment_pages import Console

RIG = ", the rig plays digital buttons"


class Form:
    """The form of a page that is open at a console."""

    def __init__(self, data, kind="experiment", **chosen):
        self.kind, self.console = kind, Console(data)
        found = self.console.operator.get("/api/design", params={"kind": kind, **chosen}).json()
        self.offered, self.values = found, found.get("values")

    def ask(self, what, **more):
        sent = {"kind": self.kind, "values": self.values, **more}
        content = json.dumps(sent)  # httpx writes no lone surrogate
        return self.console.operator.post(f"/api/design/{what}", content=content).json()


@pytest.fixture
def data(tmp_path):
    (tmp_path / "data" / "buttons").mkdir(parents=True)
    return tmp_path / "data"


@pytest.mark.parametrize("name", example_names())
def test_a_duplicate_of_an_example_is_that_example(data, name):
    form = Form(data, example=name)
    shown = form.ask("preview")
    assert shown["problem"] == "" and shown["trial"]["ask"]["kind"] == load_experiment(name).file.kind
    assert form.ask("save", folder="mine") == {"saved": "mine"}
    assert load_experiment(data / "mine").content_hash == load_experiment(name).content_hash
    again = Form(data, **{"from": "mine"})
    assert again.offered["folders"] == ["mine"] and again.ask("save", folder="more") == {"saved": "more"}
    assert load_experiment(data / "more").content_hash == load_experiment(name).content_hash


def test_the_file_says_what_each_key_means(data):
    text = Form(data, example="matching").ask("preview")["text"]
    assert 'order = "counterbalanced"' in text and "# counterbalanced: a row of Williams' square" in text


def test_the_preview_is_of_the_changed_file(data):
    form = Form(data, example="matching")
    form.values["block"][-1]["repetitions"] = 4
    form.values["question"]["text"] = 'Which "one"\x7f\n\\?'
    shown = form.ask("preview")
    steps = [row[0]["text"] + " " + row[-1]["text"] for row in shown["shown"]["tables"][0]["rows"]]
    assert steps == ["familiarisation 3", "finger calibration 10", "training 9", "experiment 12"]
    assert shown["trial"]["ask"]["text"] == form.values["question"]["text"]
    assert [name for name, _ in shown["trial"]["ask"]["choices"]] == ["latch", "toggle", "push"]
    assert form.ask("save", folder="mine") == {"saved": "mine"}
    assert load_experiment(data / "mine").file.question.text == form.values["question"]["text"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": "x"}, "seed"),
        ({"kind": "guessing"}, "kind"),
        ({"sessions": 3}, "cannot balance"),
        ({"block": []}, "block"),
        ({"question": {"identify": "colour"}}, "an identification needs"),
        ({"colour": "red"}, "colour"),
        ({"buttons": dict.fromkeys(("latch", "toggle", "push"), "../x.h5")}, "leads out of its folder"),
        ({"block": [{"name": "all", "repetitions": 1000}], "factor": [
            {"name": "button", "levels": ["latch", "toggle"]}, {"name": "level", "levels": [*"abcdef"]},
        ], "groups": ["all"]}, "10000 trials are the most"),
    ],
)  # fmt: skip
def test_what_the_loader_refuses_is_its_sentence_and_is_not_saved(data, change, words):
    form = Form(data, example="matching")
    form.values |= change
    problem = form.ask("preview")["problem"]
    assert words in problem
    with_path = data / "by-hand" / "experiment.toml"
    with_path.parent.mkdir()
    with_path.write_text(form.ask("preview")["text"], encoding="utf-8")
    with pytest.raises(ConfigurationError) as refused:
        load_experiment(with_path)
    if "leads out" not in words:  # that sentence names the folder itself
        assert str(refused.value).replace(f"{with_path.parent}/", "") == problem
    assert words in form.ask("save", folder="mine")["error"]
    assert [path.name for path in data.iterdir()] == ["buttons", "by-hand"], "nothing is left"


@pytest.mark.parametrize("folder", ["", "../x", "a/b", ".hidden", "a" * 61, "é", "buttons", None, 3.5, ["x"]])
def test_a_folder_that_is_no_new_one_is_refused(data, folder):
    form = Form(data, example="matching")
    assert "name" in form.ask("save", folder=folder)["error"]
    assert [path.name for path in data.iterdir()] == ["buttons"]


@pytest.mark.parametrize(
    "values", [None, [], "x", {"name": "\ud800"}, {"name": [[[[[[[[[[[[1]]]]]]]]]]]]}, {"\n": "x"}]
)
def test_what_no_form_sends_is_one_sentence(data, values):
    form = Form(data, example="matching")
    form.values = values
    found = form.ask("preview")
    assert (found.get("error") or found["problem"]).endswith(".")


def test_digital_buttons_are_copied_beside_the_file(data):
    form = Form(data, example=f"matching{RIG}")
    form.values["surface"] = {"releases": {"push": "deeper/release.h5"}}
    assert "There is no buttons/latch.h5" in form.ask("save", folder="mine")["error"]
    for name in ("latch", "toggle", "push"):
        (data / "buttons" / f"{name}.h5").write_text(name, encoding="utf-8")
    (data / "buttons" / "deeper").mkdir()
    (data / "buttons" / "deeper" / "release.h5").write_text("release", encoding="utf-8")
    assert form.ask("save", folder="mine") == {"saved": "mine"}
    assert sorted(path.name for path in (data / "mine").rglob("*.h5")) == [
        "latch.h5", "push.h5", "release.h5", "toggle.h5",
    ]  # fmt: skip
    again = Form(data, **{"from": "mine"})
    assert again.ask("save", folder="more", **{"from": "mine"}) == {"saved": "more"}


def test_a_button_that_a_link_leads_to_is_not_copied(data, tmp_path):
    (tmp_path / "secret").write_text("x", encoding="utf-8")
    for name in ("latch", "toggle", "push"):
        (data / "buttons" / f"{name}.h5").symlink_to(tmp_path / "secret")
    form = Form(data, example=f"matching{RIG}")
    assert "no file of the console's data folder" in form.ask("save", folder="mine")["error"]
    assert [path.name for path in data.iterdir()] == ["buttons"]


def test_a_study_is_made_and_duplicated(data):
    form = Form(data, "study", example="example")
    form.values |= {"presses": 4, "participant": {who: {"age": 31} for who in form.values["participants"]}}
    form.values["button"] = {"latch": {"force": [3, 15]}}
    rows = form.ask("preview")["shown"]["tables"][0]["rows"]
    assert [cell["text"] for cell in rows[0]] == ["P01", "latch, toggle, push", "12"]
    assert form.ask("save", folder="pilot") == {"saved": "pilot"}
    file = load_study(data / "pilot").file
    assert (file.presses, file.button["latch"].force, file.participant["P02"]["age"]) == (4, (3, 15), 31)
    again = Form(data, "study", **{"from": "pilot"})
    again.values["participants"] = ["P01", "Anna"]
    assert "Anna" in again.ask("preview")["problem"]
