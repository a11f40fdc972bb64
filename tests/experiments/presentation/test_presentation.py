"""A rig plays an experiment's digital buttons: calibration of the finger, activation, limits."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, DataError, HaploopError, LimitError
from haploop.calibration import DigitalButton
from haploop.experiments import (
    BUDGET,
    Experiment,
    Presenter,
    Step,
    Store,
    fingers_in,
    load_experiment,
    new_experiment,
    open_session,
    prepare_surface,
    read_log,
    run_session,
)
from haploop.experiments.presentation import _refuse_amplitudes
from haploop.instruments import Rig, open_rig
from haploop.mocks.people import ParticipantModel, SimulatedParticipant
from haploop.mocks.plant import touches
from tests.experiments.played import PLAYED, played
from tests.raising import raises

MATCHING = PLAYED.replace("repetitions = 1\n", "repetitions = 2\n")
RATING = """
name = "rated"
kind = "rating"
seed = 3
consent = false
buttons = { latch = "latch.h5", push = "push.h5" }
surface = { when = { category = "digital" }, releases = { push = "latch.h5" } }
factor = [
    { name = "category", levels = ["physical", "digital"] },
    { name = "button", levels = ["latch", "push"] },
]
question = { pairs = [["Rough", "Smooth"]] }
block = [{ name = "finger calibration", kind = "finger", repetitions = 2 }, { name = "ratings" }]
"""
COMPARED = """
name = "compared"
kind = "two-interval"
seed = 3
consent = false
buttons = { push = "push.h5" }
comparison = { name = "amplitude", standard = 0.5, levels = [0.0, 0.9] }
block = [{ name = "finger calibration", kind = "finger", repetitions = 2 }, { name = "experiment" }]
"""


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return played(tmp_path, made)


def experiment_of(folder: Path, text: str) -> Experiment:
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return load_experiment(folder)


@contextmanager
def presented(folder: Path, text: str) -> Iterator[tuple[Rig, Presenter, Store]]:
    experiment = experiment_of(folder, text)
    with open_rig("experiment") as rig:
        yield (
            rig,
            Presenter(prepare_surface(rig, experiment), experiment.file),
            Store(experiment, folder / "answers"),
        )


def session_of(rig: Rig, store: Store) -> Any:
    return open_session(store, "P01", rig.clock, simulated=True)


AMPLIFIER = 1.01
"""Gain error of the simulated amplifier: limits are of the volts that are commanded."""


class Leaves(SimulatedParticipant):
    """Goes away instead of answering a trial."""

    def __init__(self, trial: int) -> None:
        super().__init__(ParticipantModel(), "P01", 1)
        self._trial = trial

    def answer(self, step: Step) -> Any:
        if step.number == self._trial:
            raise KeyboardInterrupt
        return super().answer(step)


def bursts(outputs: Any, since: float) -> int:
    """How often volts began on a patch after `since` (s), a quarter second of nothing between."""
    times = np.concatenate(
        [o.start + o.period * np.flatnonzero(np.abs(o.volts) > 0.5) for o in outputs if o.closed]
    )
    times = np.sort(times[times > since])
    return int(len(times) > 0) + int(np.sum(np.diff(times) > 0.25))


@pytest.mark.long
def test_a_session_is_played_interrupted_and_resumed(folder):
    """One activation a trial, within budget and limits; the finger is not calibrated twice."""
    with presented(folder, MATCHING) as (rig, presenter, store):
        truth = rig.simulation.truth
        outputs, begun = truth.record(), rig.clock.now()
        with pytest.raises(KeyboardInterrupt), session_of(rig, store) as session:
            run_session(session, Leaves(3), presenter)
        stored = store.session("P01", 1)
        assert stored is not None and stored.due is not None
        assert (stored.due.block, stored.due.number) == ("experiment", 3)
        with session_of(rig, store) as session:
            run_session(session, SimulatedParticipant(ParticipantModel(), "P01", 1), presenter)
        assert not truth.closed and truth.peak <= AMPLIFIER * rig.limits.peak
        played = bursts(outputs, begun)
    events = read_log(store.path_of("P01", 1))
    counts = Counter(event.kind for event in events)
    assert (counts["contact"], counts["finger"], counts["surface"], counts["resumed"]) == (4, 1, 1, 1)
    # The trial that was not answered is presented again.
    assert counts["activation"] == 5 == played
    assert counts["touch"] >= 5
    for event in events:
        if event.kind != "activation":
            continue
        one = event.values
        assert one["area"] > one["threshold"] and one["press"] == "press" and one["scale"] == 1
        assert 0.02 < one["latency"] <= BUDGET
    finger = next(event.values for event in events if event.kind == "finger")
    assert finger["a_min"] < finger["areas"]["push"] < finger["areas"]["latch"] < finger["a_max"]
    surface = next(event.values for event in events if event.kind == "surface")
    assert surface["rig_simulated"] and set(surface["buttons"]) == {"latch", "push"}
    assert all(one["error"] < 0.2 for one in surface["buttons"].values())


@pytest.mark.long
def test_physical_stimuli_are_not_played_and_releases_are(folder):
    with presented(folder, RATING) as (rig, presenter, store), session_of(rig, store) as session:
        run_session(session, SimulatedParticipant(ParticipantModel(), "P01", 1), presenter)
    played = [e.values for e in read_log(store.path_of("P01", 1)) if e.kind == "activation"]
    kinds = Counter((one["button"], one["press"]) for one in played)
    assert kinds == {("latch", "press"): 1, ("push", "press"): 1, ("push", "release"): 1}
    release = next(one for one in played if one["press"] == "release")
    assert release["area"] < release["threshold"]


@pytest.mark.long
def test_two_amplitudes_are_played_one_after_the_other(folder):
    with presented(folder, COMPARED) as (rig, presenter, store):
        outputs = rig.simulation.truth.record()
        begun = rig.clock.now()
        with session_of(rig, store) as session:
            run_session(session, SimulatedParticipant(ParticipantModel(), "P01", 1), presenter)
        heard = bursts(outputs, begun)
    stored = store.session("P01", 1)
    played = [e.values for e in stored.events if e.kind == "activation"]
    steps = [step for step, _, _ in stored.answers if step.kind == "two-interval"]
    assert [one["scale"] for one in played] == [value for step in steps for value in step.values]
    assert [one["interval"] for one in played] == [1, 2, 1, 2]
    assert heard == 3, "an amplitude of zero is played as nothing"


def test_an_amplitude_beyond_the_limits_is_refused_before_anybody_comes(folder):
    text = COMPARED.replace("0.9]", "1.6]")
    with (
        pytest.raises(LimitError, match=r"up to 1\.6 times the drive of the digital push"),
        presented(folder, text),
    ):
        pass


@pytest.mark.long
def test_a_finger_that_cannot_be_calibrated_is_refused(folder, monkeypatch):
    """Firm presses no firmer than light ones: three calibrations, then one sentence; the step stays due."""
    monkeypatch.setitem(touches._FORCES, "firm", (0.4, 0.6))
    with presented(folder, MATCHING) as (rig, presenter, store):
        with pytest.raises(DataError, match=r"It was tried 3 times\."), session_of(rig, store) as session:
            run_session(session, SimulatedParticipant(ParticipantModel(), "P01", 1), presenter)
        monkeypatch.undo()
        events = read_log(store.path_of("P01", 1))
        assert Counter(event.kind for event in events)["contact"] == 12
        assert all(event.values["problem"] for event in events if event.kind == "finger")
        with session_of(rig, store) as session:
            assert session.due is not None and session.due.kind == "finger" and session.due.number == 4
            run_session(session, SimulatedParticipant(ParticipantModel(), "P01", 1), presenter)
            assert session.due is None


@pytest.mark.long
def test_a_finger_at_the_threshold_that_trembles_is_one_press(folder, monkeypatch):
    """With a tremor of a third, at 9 Hz, the area crosses the threshold again and again."""
    with presented(folder, MATCHING) as (rig, presenter, store), session_of(rig, store) as session:
        raises(KeyboardInterrupt, "", run_session, session, Leaves(1), presenter)
        outputs, begun = rig.simulation.truth.record(), rig.clock.now()
        plant = rig.simulation.plant
        shake, before = touches.touch_surface, len(plant.touches)

        def trembling(request, skin, start, rng):
            touch = shake(request, skin, start, rng)
            peak = (threshold / skin.area) ** 1.5
            return replace(touch, hold=1.5, peak=peak, skin=replace(skin, tremor=0.35))

        monkeypatch.setattr("haploop.mocks.plant.scene.touch_surface", trembling)
        session.presented()
        step, finger = session.due, fingers_in(session.events)
        assert step is not None and finger is not None
        threshold = finger["areas"][step.presented]
        presenter.present(session, step)
        touch = plant.touches[-1]
        rig.clock.sleep(touch.stop + 0.1 - rig.clock.now())
        area = touch.area(np.linspace(touch.start, touch.stop, 5000))
        assert np.sum(np.diff(area > threshold)) >= 6 and len(plant.touches) == before + 1
        assert bursts(outputs, begun) == 1
        assert rig.simulation.truth.peak <= AMPLIFIER * rig.limits.peak


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('latch = "latch.h5"\n', "", "for each level of one factor"),
        ('kind = "finger"', 'kind = "presses"', "kind 'finger' before the trials"),
        ('kind = "finger"\nrepetitions = 2', 'kind = "finger"', "needs repetitions = 2 or more"),
        ("[[factor]]", '[surface]\nwhen = { knob = "digital" }\n[[factor]]', "when needs factors"),
        ("[[factor]]", '[surface]\nreleases = { toggle = "x.h5" }\n[[factor]]', "must have names of"),
        ('[buttons]\nlatch = "latch.h5"\npush = "push.h5"', "[surface]\ntarget = 2e-4", "is for digital"),
    ],
)
def test_a_file_that_names_buttons_wrongly(tmp_path, old, new, said):
    assert old in MATCHING
    raises(ConfigurationError, said, experiment_of, tmp_path, MATCHING.replace(old, new))


def test_only_an_amplitude_can_be_compared(tmp_path):
    with pytest.raises(ConfigurationError, match="compares their amplitude"):
        experiment_of(tmp_path, COMPARED.replace('name = "amplitude"', 'name = "delay"'))


@pytest.mark.parametrize(
    ("rig", "text", "said"),
    [
        ("simulated", MATCHING, r"has no \[camera\]"),
        ("experiment", MATCHING.replace('"push.h5"', '"none.h5"'), "none.h5"),
    ],
)
def test_what_is_missing_is_one_sentence(folder, rig, text, said):
    experiment = experiment_of(folder, text)
    with open_rig(rig) as opened, pytest.raises(HaploopError, match=said):
        prepare_surface(opened, experiment)


@pytest.mark.long
def test_the_command_plays_for_a_person_and_once_more(run, folder):
    experiment_of(folder, MATCHING)
    typed = "latch\nagain\npush\nknob\npush\nlatch\n"
    result = run("experiment run", folder, "-p", "P01", "--json", ends=0, typed=typed)
    # The runner of click before 8.4 shows there what was typed.
    said = result.stdout[result.stdout.index("{") :]
    assert json.loads(said)["sessions"][0]["complete"]
    events = read_log(folder / "answers" / "P01" / "session-1.jsonl")
    assert Counter(event.kind for event in events)["activation"] == 5
    assert "simulated" in result.stderr


@pytest.mark.night
def test_the_paper_s_experiments_on_a_rig_over_two_days_from_the_command_line(run, made, tmp_path):
    """Of the examples, shortened and without the toggle: two simulated people, exported and reported."""
    buttons = [part for name in ("latch", "push") for part in ("--button", str(made / f"{name}.h5"))]
    for name in ("matching", "rating"):
        text = load_experiment(name).path.read_text(encoding="utf-8").replace('"toggle", ', "")
        text = re.sub(r"^#: toggle.*\n", "", text, flags=re.M)
        text = re.sub(r"^(#: )?repetitions = 5", r"\1repetitions = 2", text, flags=re.M)
        example = tmp_path / f"{name}.toml"
        example.write_text(re.sub(r"^repetitions = (3|10)", "repetitions = 1", text, flags=re.M), "utf-8")
        run("experiment new", tmp_path / name, "--from", example, *buttons, ends=0)
    first = run.json("experiment simulate", tmp_path / "matching", "-n", 2, "--session", 1)
    assert [one["session"] for one in first["sessions"]] == [1, 1]
    both = run.json("experiment simulate", tmp_path / "matching", "-n", 2)
    assert sorted(one["session"] for one in both["sessions"]) == [1, 1, 2, 2]
    # Of each person, training and a trial of two buttons on two days.
    assert all(one["complete"] for one in both["sessions"]) and both["latency"]["count"] == 2 * 2 * (2 + 2)
    rated = run.json("experiment simulate", tmp_path / "rating", "-n", 2)
    assert rated["latency"]["count"] == 2 * 2, "the physical buttons are not the rig's to play"
    tables = [tmp_path / "matching.csv", tmp_path / "rating.csv"]
    for table in tables:
        run.json("experiment export", table.with_suffix(""), table)
    report = run.json("report", *tables, "-o", tmp_path / "report.html")
    assert report["simulated"] and len(report["figures"]) == 6


def test_simulated_fingers_need_a_simulated_rig(run, folder):
    experiment_of(folder, MATCHING)
    run("experiment simulate", folder, "--rig", "haptable", says="has no finger")


@pytest.mark.parametrize(
    ("names", "said"),
    [(["push"], "one file of each of latch, toggle, push"), (["push", "push"], "than push")],
)
def test_a_new_experiment_of_other_buttons_is_refused(run, made, tmp_path, names, said):
    named = [part for name in names for part in ("--button", str(made / f"{name}.h5"))]
    run("experiment new", tmp_path / "new", *named, says=said)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("example", ["staircase", "two-interval"])
def test_any_button_can_be_compared_with_itself(made, tmp_path, example):
    new_experiment(tmp_path / "new", example, [made / "push.h5"])
    experiment = load_experiment(tmp_path / "new")
    assert list(experiment.file.buttons.values()) == ["button.h5"] and (tmp_path / "new/button.h5").is_file()
    with open_rig("experiment") as rig:
        _refuse_amplitudes(rig, experiment, "button", DigitalButton.load(made / "push.h5"))
