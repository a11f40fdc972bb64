"""`haploop experiment`: run an experiment with participants, real or simulated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...base.files import new_file
from ...base.wording import capital
from ...commands import public as haploop
from ...commands.options import JSON, PATH, ChosenRig, FiniteRange, NewFile, on_rig
from ...reports import outputs, show
from ...terminal.progress import Steps, note, print_either, print_line
from .. import shown as contents

if TYPE_CHECKING:
    from ...base.clock import Clock
    from ...instruments import Rig
    from ..presentation import Presenter
    from ..protocol import Step

FILE = click.argument("file", metavar="EXPERIMENT")
DATA = click.option(
    "--data",
    "-d",
    type=PATH,
    metavar="DIR",
    help="Folder with the participants' answers.  [default: 'answers' beside the experiment's file]",
)
MODEL = click.option(
    "--model",
    type=PATH,
    metavar="FILE.toml",
    help="Model of the simulated participants.  [default: built in]",
)


RIG = click.option(
    "--rig",
    "-r",
    default="experiment",
    show_default=True,
    metavar="FILE",
    help="Rig with a camera, for an experiment whose [buttons] it plays. Otherwise no rig is opened.",
)


@click.group(no_args_is_help=True)
def experiment() -> None:
    """Run an experiment with people, from a file.

    EXPERIMENT is a TOML file, the folder of an experiment.toml, or the name of an example: matching, rating,
    two-interval, staircase.
    """


@experiment.command()
@click.argument("folder", type=PATH)
@click.option("--from", "example", default="matching", show_default=True, help="Example to copy.")
@click.option(
    "--button",
    "buttons",
    multiple=True,
    type=PATH,
    metavar="BUTTON.h5",
    help="Digital button that the rig plays in it; once for each button of the example. It is copied too.",
)
def new(folder: Path, example: str, buttons: Sequence[Path]) -> int:
    """Create a FOLDER with an experiment.toml to change.

    With --button the rig plays the digital buttons, of which each must be named as a level of the example.
    """
    haploop.experiments.new_experiment(folder, example, buttons)
    path = folder / "experiment.toml"
    print_line(f"Change {path}, then: haploop experiment run {folder} --participant P01")
    return 0


@experiment.command()
@FILE
@click.option("--participant", "-p", required=True, help="Pseudonym of the participant, for example P01.")
@click.option("--session", type=click.IntRange(min=1), help="Session that is expected to be due.")
@click.option("--simulated", is_flag=True, help="A simulated participant answers.")
@MODEL
@DATA
@on_rig(RIG)
@JSON
def run(
    file: str,
    participant: str,
    session: int | None,
    simulated: bool,
    model: Path | None,
    data: Path | None,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Run the session of a participant that is due. Stop with Ctrl-C; the next run continues there.

    If the experiment names digital [buttons], the rig measures the participant's finger and plays them.
    """
    store = _store(file, data)
    if model and not simulated:
        raise click.UsageError("--model is the model of a simulated participant: add --simulated.")
    loaded = _model(model)
    ask = partial(_consent, participant, simulated)
    due = store.next_session(participant)
    hours = store.soon_after(participant, due) if due else None
    with (
        _rig_of(store, rig, simulated) as surface,
        haploop.experiments.open_session(
            store, participant, _clock(surface), session, simulated=simulated, consent=ask
        ) as opened,
    ):
        if simulated:
            note("A simulated participant answers.")
        number = opened.assignment.session
        if hours is not None:
            note(
                f"{participant}'s session {number - 1} ended {hours:.1f} hours ago: is this really day "
                f"{number}? Ctrl-C ends it; begun again, it goes on."
            )
        presenter = _presenter(store, surface)
        person = _AtTerminal(presenter)
        answers = haploop.mocks.SimulatedParticipant(loaded, participant, number) if simulated else person
        haploop.experiments.run_session(opened, answers, presenter)
    show.print_contents(contents.experiment_contents(store), as_json)
    return 0


@experiment.command()
@FILE
@click.option(
    "--participants", "-n", type=click.IntRange(1, 9999), default=20, show_default=True, help="How many."
)
@click.option(
    "--session",
    type=click.IntRange(min=1),
    help="Last session to run: 1 is the study's first day.  [default: all]",
)
@MODEL
@DATA
@on_rig(RIG)
@JSON
def simulate(
    file: str,
    participants: int,
    session: int | None,
    model: Path | None,
    data: Path | None,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Run the sessions of simulated participants.

    They are P01 and so on; sessions that are complete stay as they are.

    If the experiment names digital [buttons], they press the simulated rig's surface, which plays them.
    """
    store, loaded = _store(file, data), _model(model)
    names = [f"P{number:02}" for number in range(1, participants + 1)]
    last = session or store.experiment.file.sessions
    with _rig_of(store, rig, simulated=True) as surface:
        clock, presenter = _clock(surface), _presenter(store, surface)
        with Steps() as steps:
            for done, name in enumerate(names):
                while (number := store.next_session(name)) is not None and number <= last:
                    who = haploop.mocks.SimulatedParticipant(loaded, name, number)
                    with haploop.experiments.open_session(
                        store, name, clock, number, simulated=True
                    ) as opened:
                        haploop.experiments.run_session(opened, who, presenter)
                steps("Simulated participants", done + 1, len(names), "")
    show.print_contents(contents.experiment_contents(store), as_json)
    return 0


@experiment.command()
@click.argument("buttons", nargs=-1, required=True, type=PATH, metavar="BUTTON.h5...")
@click.option(
    "--out",
    "-o",
    type=NewFile(".toml"),
    metavar="MODEL.toml",
    help="Model for `haploop experiment simulate`.",
)
@JSON
def predict(buttons: Sequence[Path], out: Path | None, as_json: bool) -> int:
    """Predict which buttons people will confuse.

    Each BUTTON.h5 is a digital button (`haploop button make`) of another physical one. The prediction is a
    range: what nobody knows is drawn at random many times. It stands beside the paper's tables III and IV.
    """
    found = haploop.experiments.predict_answers([haploop.DigitalButton.load(one) for one in buttons])
    if out is not None:
        with new_file(out) as part:
            part.write_text(haploop.experiments.participant_model(found), encoding="utf-8", newline="\n")
    show.print_contents(contents.prediction_contents(found), as_json)
    return 0


@experiment.command()
@FILE
@DATA
@JSON
def status(file: str, data: Path | None, as_json: bool) -> int:
    """Show who has answered what.

    Exit codes: 0 every log can be read, 2 one is damaged, missing or cut short.
    """
    found = contents.experiment_contents(_store(file, data))
    show.print_contents(found, as_json)
    return 2 if found.values["problems"] else 0


@experiment.command()
@FILE
@click.argument("out", type=PATH, metavar="OUT.csv")
@click.option("--practice", is_flag=True, help="Also answers of practice blocks.")
@DATA
@JSON
def export(file: str, out: Path, practice: bool, data: Path | None, as_json: bool) -> int:
    """Write all answers as a table for `haploop analyse`.

    OUT.csv gets a row an answer, OUT.json what its columns are.
    """
    for path in (out, out.with_suffix(".json")):
        outputs.check_new_file(path)
    if out.suffix == ".json":
        raise click.UsageError(f"{out} is the name of the description: use a name that ends with .csv.")
    store = _store(file, data)
    lines = haploop.experiments.export_answers(store, out, practice)
    unfinished = [f"{one.path.parent.name}/{one.path.name}" for one in store.unfinished()]
    description = str(out.with_suffix(".json"))
    said = [f"{out} has {lines} lines; {description} describes its columns."]
    if unfinished:
        said.append(f"Not complete: {', '.join(unfinished)}. Their lines say so (column complete).")
    values = {"file": str(out), "description": description, "lines": lines, "unfinished": unfinished}
    print_either(as_json, values, *said)
    return 0


@experiment.command()
@FILE
@click.argument("participant")
@click.option("--yes", is_flag=True, help="Do not ask.")
@DATA
@JSON
def withdraw(file: str, participant: str, yes: bool, data: Path | None, as_json: bool) -> int:
    """Delete everything that belongs to PARTICIPANT.

    Nothing outside the experiment's folder is touched: tables that were exported before, recordings of
    presses, backups. It is noted that this was done, with the pseudonym and the names of the files.
    """
    store = _store(file, data)
    if not yes:
        click.confirm(f"Delete all answers of {participant} in {store.folder}?", abort=True, err=True)
    done = store.withdraw(participant)
    print_either(
        as_json,
        {"participant": participant, "deleted": list(done.files), "time": done.time},
        f"Deleted {len(done.files)} files of {participant}: {', '.join(done.files) or 'none'}. Tables "
        "exported before, recordings of presses, and backups may still hold something of them.",
    )
    return 0


class _AtTerminal:
    """A participant, or the operator, at a terminal."""

    def __init__(self, presenter: Presenter | None) -> None:
        self._presenter = presenter
        self._block = ""

    def answer(self, step: Step) -> Any:
        """See `haploop.experiments.Answerer`."""
        if step.block != self._block:
            self._block = step.block
            note(f"--- {capital(step.block)}")
        head = f"{step.number} of {step.of}. " if step.kind != "staircase" else f"{step.number}. "
        can_repeat = self._presenter is not None and self._presenter.presents(step)
        again = [haploop.experiments.AGAIN] if can_repeat else []
        match step.kind:
            case "presses":
                name = next(iter(step.stimulus.values()), "")
                times = "once" if step.repetitions == 1 else f"{step.repetitions} times"
                return self._done(f"{head}{step.text} Press the physical {name} button {times}.")
            case "finger":
                return self._done(f"{head}{step.text} A {step.stimulus['press']} press.")
            case "rating":
                note(f"{head}{step.text} ({', '.join(step.stimulus.values())})")
                if again and click.confirm("Feel it once more?", default=False, err=True):
                    return haploop.experiments.AGAIN
                return _rated(step)
            case "identification":
                return click.prompt(
                    f"{head}{step.text}", type=click.Choice([*step.choices, *again]), err=True
                )
            case _:
                answer = click.prompt(f"{head}{step.text}", type=click.Choice(["1", "2", *again]), err=True)
                return answer if answer == haploop.experiments.AGAIN else int(answer)

    def told(self, step: Step, right: bool) -> None:
        """See `haploop.experiments.Answerer`."""
        note("Right." if right else f"No, it was {step.presented}." if step.presented else "No.")

    @staticmethod
    def _done(sentence: str) -> str:
        click.prompt(f"{sentence} Then Enter", default="", show_default=False, err=True)
        return "done"


def _rated(step: Step) -> dict[str, Any]:
    """Ask for each scale: there is no value that Enter takes."""
    low, high = step.values
    clock, answer = haploop.RealClock(), {}
    began = clock.now()
    for pair in step.choices:
        value = click.prompt(f"{pair} ({low:g} to {high:g})", type=FiniteRange(low, high), err=True)
        answer[pair] = {"value": value, "touched": [round(clock.now() - began, 3)]}
    return answer


def _store(file: str, data: Path | None) -> haploop.experiments.Store:
    loaded = haploop.experiments.load_experiment(file)
    if data is None and file in haploop.experiments.example_names() and not Path(file).exists():
        data = Path(f"{file}-answers")  # an example lies in the installed package, where nothing is written
    return haploop.experiments.Store(loaded, data or loaded.path.parent / "answers")


@contextmanager
def _rig_of(store: haploop.experiments.Store, rig: ChosenRig, simulated: bool) -> Iterator[Rig | None]:
    """Open the rig for an experiment with digital buttons; None for one without."""
    if not store.experiment.file.buttons:
        yield None
        return
    described = rig.load()
    if simulated and not (rig.simulate or described.simulate):
        raise haploop.ConfigurationError(
            f"A simulated participant has no finger for the rig {described.name!r}: add --simulate twin."
        )
    with rig.opened() as opened:
        yield opened


def _clock(rig: Rig | None) -> Clock:
    return haploop.RealClock() if rig is None else rig.clock


def _presenter(store: haploop.experiments.Store, rig: Rig | None) -> Presenter | None:
    if rig is None:
        return None
    with Steps() as steps:
        surface = haploop.experiments.prepare_surface(rig, store.experiment, steps)
    return haploop.experiments.Presenter(surface, store.experiment.file)


def _consent(participant: str, simulated: bool) -> bool:
    return simulated or click.confirm(
        f"Has {participant} read and signed the consent form?", default=None, err=True
    )


def _model(path: Path | None) -> haploop.mocks.ParticipantModel:
    return haploop.mocks.load_participant_model(path) if path else haploop.mocks.ParticipantModel()
