"""Experiments as files: the paper's two, orders, staircases, and files that are wrong."""

from collections import Counter

import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.experiments.protocol import (
    Answer,
    Assignment,
    Course,
    Experiment,
    Rated,
    Step,
    balance_of,
    example_names,
    group_of_slot,
    load_experiment,
    right_answer,
    session_levels,
    timing_of,
    valid,
)
from tests.raising import raises


def steps_of(experiment: Experiment, slot: int = 0, session: int = 1, participant: str = "P01") -> list[Step]:
    """All steps of a session whose answers are all right."""
    assignment = Assignment(participant, slot, group_of_slot(experiment.file, slot), session)
    course = Course(experiment.file, assignment)
    answers: list[tuple[Step, Answer]] = []
    while (step := course.due(answers)) is not None:
        answers.append((step, right_answer(step) or "done"))
    return [step for step, _ in answers]


def test_the_paper_s_first_experiment():
    experiment = load_experiment("matching")
    steps = steps_of(experiment)
    assert Counter(step.block for step in steps) == {
        "familiarisation": 3, "finger calibration": 10, "training": 9, "experiment": 30,
    }  # fmt: skip
    assert all(step.repetitions == 10 for step in steps if step.kind == "presses")
    assert Counter(s.stimulus["press"] for s in steps if s.kind == "finger") == {"light": 5, "firm": 5}
    for block, each in (("training", 3), ("experiment", 10)):
        presented = Counter(step.presented for step in steps if step.block == block)
        assert presented == {"latch": each, "toggle": each, "push": each}
    assert {step.choices for step in steps if step.presented} == {("latch", "toggle", "push")}


def test_confirmation_changes_with_group_and_day():
    """Table I: group I none on day 1, given on day 2; group II the other way round."""
    file = load_experiment("matching").file
    expected = {("I", 1): "none", ("I", 2): "given", ("II", 1): "given", ("II", 2): "none"}
    for (group, day), level in expected.items():
        assignment = Assignment("P01", 0, group, day)
        assert session_levels(file, assignment) == {"confirmation": level}
        told = {step.feedback for step in Course(file, assignment)._fixed[2]}
        assert told == {level == "given"}
        assert {step.feedback for step in Course(file, assignment)._fixed[3]} == {False}


def test_groups_are_random_and_balanced():
    file = load_experiment("matching").file
    groups = [group_of_slot(file, slot) for slot in range(20)]
    assert Counter(groups) == {"I": 10, "II": 10}
    assert groups != ["I", "II"] * 10
    assert all(set(groups[n : n + 2]) == {"I", "II"} for n in range(0, 20, 2))


def test_a_design_says_when_it_is_balanced():
    """Two groups, and six orders of three buttons in familiarisation."""
    file = load_experiment("matching").file
    balanced = [n for n in range(14) if balance_of(file, range(n)).balanced]
    assert balanced == [0, 6, 12]
    seven = balance_of(file, range(7))
    assert seven.multiple_of == 6 and sorted(seven.groups.values()) == [3, 4]
    assert not balance_of(file, [0, 1, 2, 3, 4, 6]).balanced, "one place is empty, one order is used twice"
    assert balance_of(load_experiment("rating").file, range(7)).balanced


def test_an_order_is_stored_by_its_seed_and_six_participants_have_every_order():
    experiment = load_experiment("matching")
    assert steps_of(experiment) == steps_of(load_experiment("matching"))
    assert steps_of(experiment) != steps_of(experiment, participant="P02")
    assert steps_of(experiment) != steps_of(experiment, session=2)
    orders = {
        tuple(step.stimulus["button"] for step in steps if step.block == "familiarisation")
        for slot in range(6)
        for steps in [steps_of(experiment, slot, participant=f"P{slot}")]
    }
    assert len(orders) == 6
    assert all(steps_of(load_experiment(name)) for name in example_names()), "each example can be run"


def test_two_blocks_alike_have_orders_of_their_own(tmp_path):
    path = tmp_path / "experiment.toml"
    text = load_experiment("rating").path.read_text(encoding="utf-8")
    path.write_text(f'{text}\n[[block]]\nname = "again"\norder = "random"\n', encoding="utf-8")
    stimuli = [step.stimulus for step in steps_of(load_experiment(path))]
    assert len(stimuli) == 12 and stimuli[:6] != stimuli[6:]


def test_the_paper_s_second_experiment():
    steps = steps_of(load_experiment("rating"))
    assert len(steps) == 6
    assert len({(step.stimulus["category"], step.stimulus["button"]) for step in steps}) == 6
    assert steps[0].choices == ("Unpleasant-Pleasant", "Uncomfortable-Comfortable", "Unclear-Clear",
        "Unstable-Stable", "Delayed-Quick", "Unreliable-Reliable", "Rough-Smooth")  # fmt: skip


def test_a_staircase_converges():
    """Right above 0.3 of the standard, wrong below: it ends around 0.3."""
    experiment = load_experiment("staircase")
    course = Course(experiment.file, Assignment("P01", 0, "all", 1))
    answers: list[tuple[Step, Answer]] = []
    values: list[float] = []
    while (step := course.due(answers)) is not None:
        value = max(step.values)
        right = right_answer(step)
        assert right is not None
        answers.append((step, right if value > 0.3 else (2 if right == 1 else 1)))
        values.append(value)
    assert len(values) < 160 and sum(value == 0.5 for value in values) >= 2
    assert abs(sum(values[-10:]) / 10 - 0.3) < 0.05
    assert {step.values.index(max(step.values)) for step, _ in answers} == {0, 1}
    restarts = [k for k in range(1, len(values)) if values[k] == values[0] and values[k - 1] < 0.4]
    assert len(restarts) == experiment.file.block[-1].repetitions - 1


def test_two_intervals_compare_each_level_in_both_orders():
    steps = [step for step in steps_of(load_experiment("two-interval")) if not step.practice]
    assert Counter(max(step.values) for step in steps) == dict.fromkeys((0.55, 0.6, 0.7, 0.8, 0.9, 1.0), 20)
    first = sum(step.values[0] > 0.5 for step in steps)
    assert 40 <= first <= 80 and all(0.5 in step.values for step in steps)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('kind = "identification"', 'kind = "identifying"'), "line 7.*kind"),
        (('identify = "button"', 'identify = "knob"'), "varies by trial"),
        (('name = "button"', 'name = "group"'), "cannot be called 'group'"),
        (('levels = ["latch", "toggle", "push"]', 'levels = ["latch", "latch"]'), "listed twice"),
        (('feedback = { confirmation = "given" }', 'feedback = { confirmation = "yes" }'), "feedback"),
        (("repetitions = 3", "repetitions = 0"), "repetitions"),
        (("repetitions = 3", "repeat = 3"), "repeat"),
        (('groups = ["I", "II"]', 'groups = ["I", "I"]'), "listed twice"),
        (('kind = "identification"', 'kind = "staircase"'), r"\[comparison\]"),
        (("seed = 2020", "seed = "), "not valid TOML"),
        (("seed = 2020", "seed = 9007199254740993"), "seed"),
        (('groups = ["I", "II"]', 'groups = ["I", "II", "III"]'), "number of groups must be a multiple of 2"),
        (('groups = ["I", "II"]', ""), "groups = 1 and sessions = 2 cannot balance"),
        (("sessions = 2", "sessions = 3"), "groups = 2 and sessions = 3 cannot balance"),
        (
            ('[[factor]]\nname = "button"', '[[factor]]\nname = "noise"\nlevels = ["a", "b"]\n'
             'varies = "session"\n[[factor]]\nname = "button"'),
            "'confirmation', 'noise' vary by session, and change together",
        ),
    ],
)  # fmt: skip
def test_a_wrong_file_or_an_uneven_latin_square_is_refused(tmp_path, change, said):
    text = load_experiment("matching").path.read_text(encoding="utf-8")
    assert change[0] in text
    path = tmp_path / "experiment.toml"
    path.write_text(text.replace(*change), encoding="utf-8")
    raises(ConfigurationError, said, load_experiment, tmp_path)
    path.write_text(text.replace("sessions = 2", "sessions = 1"), encoding="utf-8")
    assert load_experiment(path).file.sessions == 1, "a factor between groups needs one session only"
    raises(ConfigurationError, "matching, rating", load_experiment, "nothing.toml")


def test_a_comment_does_not_change_an_experiment(tmp_path):
    original = load_experiment("matching")
    path = tmp_path / "experiment.toml"
    path.write_text("# mine\n" + original.path.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_experiment(path).content_hash == original.content_hash
    path.write_text(path.read_text(encoding="utf-8").replace("seed = 2020", "seed = 2021"), encoding="utf-8")
    assert load_experiment(path).content_hash != original.content_hash


@pytest.mark.parametrize("answer", ["knob", 1, None, True, {"latch": 1.0}])
def test_an_answer_that_is_none_is_refused(answer):
    step = next(step for step in steps_of(load_experiment("matching")) if step.presented)
    raises(DataError, "one of latch, toggle, push", valid, step, answer)


@pytest.mark.parametrize(
    "one",
    [
        *({"value": value, "touched": [1.0]} for value in (0.99, 101.1, float("nan"), "50", True, None)),
        *({"value": 51.0, "touched": touched} for touched in ([], None, "1", [-0.1], [2.0, 1.0], [True])),
        {"value": 51.0, "touched": [float("nan")]},
        {"value": 51.0},
        51.0,
    ],
)
def test_a_rating_beyond_the_scale_or_that_was_not_touched_is_refused(one):
    step = steps_of(load_experiment("rating"))[0]
    middle: dict[str, object] = {pair: {"value": 51.0, "touched": [1.0, 1.5]} for pair in step.choices}
    assert valid(step, middle) == dict.fromkeys(step.choices, Rated(51.0, (1.0, 1.5)))
    said = r"from 1 to 101, and when .* for Delayed-Quick .a scale has no value until it is touched"
    raises(DataError, said, valid, step, middle | {"Delayed-Quick": one})
    raises(DataError, "from 1 to 101", valid, step, {"Delayed-Quick": {"value": 51.0, "touched": [1.0]}})


@pytest.mark.parametrize(
    ("touches", "duration", "timing"),
    [
        ((), 0.099, "too fast"),
        ((), 0.1, "possible"),
        ((), 600.0, "possible"),
        ((), 600.1, "too slow"),
        ((), None, "n/a"),
        ((0.1, 0.2), 1.0, "possible"),
        ((0.1, 0.19), 1.0, "too fast"),  # however long the stimulus was waited for
        ((0.1, 0.9), 0.15, "too fast"),
    ],
)
def test_what_a_person_can_do(touches, duration, timing):
    answer = {str(n): Rated(1.0, (one, 50.0)) for n, one in enumerate(touches)} or "latch"
    assert timing_of(answer, duration) == timing
