"""study.toml: what it may say, what it may not, and where the sentence points."""

import re
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from haploop.acquisition import Protocol, load_study
from haploop.acquisition.presses.segmentation import segmentation_for
from haploop.acquisition.session.study_file import load_study_file
from haploop.base.errors import ConfigurationError
from haploop.commands.study import STUDY_FORM
from tests.raising import raises

GOOD = """
name = "trial"
buttons = ["latch", "toggle", "push"]
participants = ["P01", "P02", "P03"]
"""


def refused(folder, text: str) -> str:
    (folder / "study.toml").write_text(text, encoding="utf-8")
    sentence = raises(ConfigurationError, "", load_study, folder)
    assert sentence.count("\n") == 0
    return sentence


def loaded(folder, text: str):
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study_file(folder / "study.toml")


@pytest.mark.parametrize(("line", "expected"), [
    ('participants = ["Mustafa Emre"]', "Do not use a person's name"),
    ('participants = ["../P01"]', "is not a valid participant pseudonym"),
    ('participants = ["P01", "P01"]', "P01 is listed twice"),
    ('participants = ["P01", "p01"]', "differ only in upper and lower case"),
    ("participants = []", "1 or more entries"),
    ('buttons = ["../../etc/passwd"]', "is not a valid button name"),
    ('buttons = ["C:\\\\latch"]', "is not a valid button name"),
    ("presses = 0", "1 or more"),
    ('order = "randomly"', "'counterbalanced', 'random' or 'as-listed'"),
    ('order = "random"', 'a seed is required with order = "random"'),
    ("seed = 3", "not allowed with any other order"),
    ('particpants = ["P01"]', "did you mean 'participants'?"),
    ('prompts = { ready = "{name}, please" }', "only these placeholders: {participant}, {button}, {presses}"),
    ('prompts = { press = "{number:{of}" }', "may contain only these placeholders"),
    ('button = { latch = { prompt = "{}" } }', "may contain only these placeholders"),
    ("button = { doorbell = { presses = 3 } }", "there is no 'doorbell' in buttons (latch, toggle, push)"),
    ("button = { latch = { force = [5, 2] } }", "the lowest force must be below the highest"),
    ("button = { latch = { segmentation = { pressure = 1 } } }", "there is no parameter 'pressure'"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence_with_its_line(tmp_path, line, expected):
    key = line.split(" ")[0]
    others = [kept for kept in GOOD.strip().splitlines() if not kept.startswith(f"{key} ")]
    text = "\n".join([*others, line, ""])
    sentence = refused(tmp_path, text)
    assert expected in sentence
    assert str(tmp_path / "study.toml") in sentence
    if line != 'order = "random"':  # what is wrong is that no seed stands anywhere
        assert f"line {len(text.splitlines())}: " in sentence


def test_what_is_no_study_file(tmp_path):
    raises(ConfigurationError, "There is no study file", load_study, tmp_path)
    assert "is not valid TOML" in refused(tmp_path, "name = ")
    (tmp_path / "study.toml").write_bytes(b"\xff\xfe")
    raises(ConfigurationError, "is not text in UTF-8", load_study, tmp_path)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_a_counterbalanced_order_has_each_button_follow_each_other_equally_often(tmp_path, count):
    buttons = [f"b{index}" for index in range(count)]
    rows = count if count % 2 == 0 else 2 * count
    names = ", ".join(f'"P{index}"' for index in range(1, rows + 1))
    file = loaded(tmp_path, f'name = "t"\nbuttons = {buttons}\nparticipants = [{names}]\n')
    orders = [file.order_for(participant) for participant in file.participants]
    follows = Counter(pair for order in orders for pair in pairwise(order))
    places = Counter(pair for order in orders for pair in enumerate(order))
    assert len(follows) == count * (count - 1)
    assert len(set(follows.values())) == len(set(places.values())) == 1


@pytest.mark.parametrize("order", ['"counterbalanced"', '"random"\nseed = 4', '"as-listed"'])
def test_who_is_added_later_changes_nobody_s_order(tmp_path, order):
    before = loaded(tmp_path, f"{GOOD}order = {order}\n")
    more = GOOD.replace('"P03"', '"P03", "P04"')
    after = loaded(tmp_path, f"{more}order = {order}\n")
    for participant in before.participants:
        assert after.order_for(participant) == before.order_for(participant)
        assert sorted(after.order_for(participant)) == ["latch", "push", "toggle"]
    assert "P04" in after.participants


def test_a_button_s_own_settings(tmp_path):
    file = loaded(
        tmp_path,
        GOOD
        + """patience = 20
attempts = 2
wait = 5
[prompts]
press = "{button}!"
[button.latch]
presses = 20
force = [3, 15]
prompt = "Press it until it stays ({number} of {of})."
segmentation = { quiet = 0.2 }
""",
    )
    assert (file.presses_of("latch"), file.presses_of("push")) == (20, 10)
    assert file.prompt_for("latch").startswith("Press it until it stays")
    assert file.prompt_for("push") == "{button}!"
    assert file.protocol_for("latch").force == (3, 15)
    assert file.protocol_for("latch").segmentation == replace(segmentation_for("latch"), quiet=0.2)
    own = Protocol(patience=20, attempts=2, wait=5, segmentation=segmentation_for("push"))
    assert file.protocol_for("push") == own
    usual = Protocol(wait=600, segmentation=segmentation_for("push"))
    assert loaded(tmp_path, GOOD).protocol_for("push") == usual


def test_participants_have_the_same_columns_and_no_prompt_holds_one(tmp_path):
    described = '[participant.P01]\nage = 31\nsex = "f"\n'
    file = loaded(tmp_path, f"{GOOD}{described}")
    assert file.participant == {"P01": {"age": 31, "sex": "f"}}
    for more, expected in (
        ("[participant.P02]\nage = 20\n", "P02 has no 'sex', which others have"),
        ('[participant.P02]\nage = 2\nsex = "f"\nglases = true\n', "P02 has 'glases', which others do not"),
        ("[participant.P09]\nage = 2\n", "there is no 'P09' in participants (P01, P02, P03)"),
        ("[participant.P02]\nage = nan\nsex = 'f'\n", "is a text, a finite number, true or false"),
        ("[participant.P02]\nage = [2]\nsex = 'f'\n", "is a text, a finite number, true or false"),
    ):
        assert expected in refused(tmp_path, f"{GOOD}{described}{more}")
    assert "{participant}" in refused(tmp_path, f'{GOOD}[prompts]\nready = "{{age}}"\n')


def test_what_the_guide_and_a_new_study_show_can_be_loaded(tmp_path):
    root = Path(__file__).parents[3]
    guide = (root / "docs" / "how-to" / "recording.md").read_text(encoding="utf-8")
    tables = re.findall(r"^```toml\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    (example,) = (table for table in tables if "participants" in table)
    file = loaded(tmp_path, example)
    assert file.prompt_for("latch").startswith("Press the latch until it stays")
    assert file.prompts.ready.format(participant="P01", button="latch", presses=3).startswith("P01: index")
    new = STUDY_FORM.format(name='"pilot"')
    assert loaded(tmp_path, new).participants == ("P01", "P02", "P03")
    everything = loaded(tmp_path, re.sub(r"^# (?=\[|\w+ = )", "", new, flags=re.MULTILINE))
    assert everything.presses_of("latch") == 20
    assert everything.prompts.consent.startswith("Has {participant}")
