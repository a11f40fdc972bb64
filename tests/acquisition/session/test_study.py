"""A study is recorded, interrupted and gone on with: nothing is lost, or asked for twice."""

import json
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from haploop.acquisition import (
    Recording,
    accepted_presses,
    load_study,
    open_part,
    representative,
    run_study,
    verify,
    with_presses,
)
from haploop.acquisition.session.session_run import SessionRun
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.instruments import Consent, Press, Ready, open_rig
from tests import forked
from tests.acquisition.session import studying
from tests.raising import raises


def study_in(folder: Path, **keys):
    keys = {"buttons": ["latch", "toggle"], "participants": ["P01", "P02"], "presses": 2} | keys
    keys["name"] = "trial"
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder)


def twin(**simulation):
    return open_rig("simulated", simulate="twin", simulation=simulation)


def told_of(rig) -> list:
    """What the operator is asked from now on."""
    requests, tell, confirm = [], rig.operator.tell, rig.operator.confirm

    def confirmed(request):
        if isinstance(request, Consent | Ready):
            requests.append(request)
        return confirm(request)

    rig.operator.tell = lambda request: (requests.append(request), tell(request))[1]
    rig.operator.confirm = confirmed
    return requests


def outcome(study) -> dict:
    """(participant, button, number) -> (attempt, force (N)) of every press that counts."""
    found = {}
    for entry in study.progress():
        for recording in entry.recordings:
            presses = accepted_presses(recording)
            for verdict, press in zip(
                sorted(recording.accepted, key=lambda one: one.first), presses, strict=True
            ):
                key = (entry.participant, entry.button, verdict.number)
                assert key not in found, "one press counts twice"
                found[key] = (verdict.attempt, press.force_at_activation)
    return found


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A study of 2 x 2 x 2 presses, one participant's recorded; not to be changed."""
    study = study_in(tmp_path_factory.mktemp("small"))
    with twin(seed=3) as rig:
        requests = told_of(rig)
        assert run_study(rig, study, ["P01"])
    return study, requests


def test_no_recording_of_a_study_keeps_its_samples_in_memory(small):
    """Of 36,000 presses they are gigabytes."""
    study, _ = small
    read = [
        one for entry in study.progress() if entry.accepted and entry.consented for one in entry.recordings
    ]
    read += study.recordings("latch")
    read += with_presses([open_part(one.path, "trial") for one in read])
    assert len(read) == 6 and not any("_checked" in vars(one) for one in read)


def test_columns_of_a_participant_are_kept_and_never_told(tmp_path):
    study = study_in(tmp_path, buttons=["toggle"], participants=["P01"], presses=1)
    with study.path.open("a", encoding="utf-8") as file:
        file.write('[participant.P01]\nage = 31\nhandedness = "ambidextrous"\n')
    study = load_study(tmp_path)
    with twin(seed=3) as rig:
        requests = told_of(rig)
        assert run_study(rig, study)
    (recording,) = study.recordings("toggle")
    assert recording.about == {"age": 31, "handedness": "ambidextrous"}
    assert requests and not any("31" in repr(one) or "ambidextrous" in repr(one) for one in requests)


def copied(study, folder: Path):
    """The same study elsewhere."""
    (folder / "recordings").mkdir(parents=True)
    for path in (study.path, *study.folder.iterdir()):
        (folder / path.relative_to(study.path.parent)).write_bytes(path.read_bytes())
    return load_study(folder)


def test_a_participant_is_asked_for_consent_once_and_then_for_each_button(small):
    study, requests = small
    kinds = [request for request in requests if isinstance(request, Consent | Ready | Press)]
    assert kinds[:2] == [Consent("P01"), Ready("P01", "latch", 2)]
    assert [str(request) for request in kinds[2:4]] == [f"Press the latch button ({n} of 2)." for n in (1, 2)]
    assert [type(request) for request in kinds] == [Consent, Ready, Press, Press, Ready, Press, Press]
    assert [len(one.accepted) for one in study.progress()] == [2, 2, 0, 0]
    assert [one.consented for one in study.progress()] == [True, True, False, False]
    (recording,) = study.recordings("latch")
    assert (recording.header.study, recording.header.session) == ("trial", "1")
    assert recording.events[0].text == "The operator confirmed that P01 consented."
    assert verify(recording.path) == ()


def test_a_rejected_press_is_asked_for_again_and_its_recording_stays(small, tmp_path):
    study = copied(small[0], tmp_path)
    before = (study.folder / "P01-latch.h5").read_bytes()
    (rejection,) = study.reject("P01", "latch", [2], "the phone rang")
    assert (rejection.file, rejection.number, rejection.attempt) == ("P01-latch.h5", 2, 1)
    entry = study.progress_of("P01", "latch")
    assert (entry.accepted, entry.missing, entry.rejected) == ((1,), ((2, 2),), 1)
    assert entry.verdicts[1].reason == "Rejected: the phone rang"
    raises(ConfigurationError, "P01 has no accepted press 2 of latch", study.reject, "P01", "latch", [2])
    # A participant that was added meanwhile changes nobody's order, and nothing is asked twice.
    study = study_in(tmp_path, participants=["P01", "P02", "P03"])
    with twin(seed=3) as rig:
        requests = told_of(rig)
        assert run_study(rig, study, ["P01", "P03"], ["latch"])
    asked = [(r.participant, r.number, r.attempt) for r in requests if isinstance(r, Press)]
    assert asked == [("P01", 2, 2), ("P03", 1, 1), ("P03", 2, 1)]
    assert Consent("P01") not in requests
    names = [r.path.name for r in study.progress_of("P01", "latch").recordings]
    assert names == ["P01-latch.h5", "P01-latch.2.h5"]
    assert (study.folder / "P01-latch.h5").read_bytes() == before
    press = representative(study.recordings("latch"))
    assert press.members == 4
    assert press.left_out == ("P01, press 2, attempt 1: Rejected: the phone rang",)


def test_no_consent_no_recording(small, tmp_path):
    study = copied(small[0], tmp_path)
    with twin() as rig:
        rig.operator.confirm = lambda request: not isinstance(request, Consent)
        raises(DataError, "P02 has not consented, so nothing was recorded", run_study, rig, study)
        assert not list(study.folder.glob("P02*"))
        rig.operator.confirm = lambda request: not isinstance(request, Ready)
        assert run_study(rig, study) is False
    assert not list(study.folder.glob("P02*"))


def test_what_does_not_belong_is_refused(small, tmp_path):
    study = copied(small[0], tmp_path)
    latch, toggle = study.folder / "P01-latch.h5", study.folder / "P02-toggle.h5"
    with twin() as rig, open_rig("stock-accelerometer", simulate="twin") as other:
        for says, of, who, which in (
            ("no participant 'P09', only P01, P02", rig, ["P09"], None),
            ("no button 'doorbell'", rig, None, ["doorbell"]),
            ("record a study on one rig only", other, None, None),
        ):
            raises(ConfigurationError, says, run_study, of, study, who, which)
    belongs = r"P02-toggle.h5 belongs to the study 'trial' \(button latch, participant P01\), not to"
    for length, says in ((None, belongs), (5000, "truncated")):
        toggle.write_bytes(latch.read_bytes()[:length])
        raises(DataError, says, study.progress)
    toggle.unlink()
    study.reject("P01", "latch", [1])
    latch.write_bytes((study.folder / "P01-latch.h5").read_bytes())
    (study.folder / "rejections.json").write_text('{"file": "P01-latch', encoding="utf-8")
    with pytest.raises(DataError, match=r"rejections\.json is damaged"):
        study.progress_of("P01", "latch").accepted  # noqa: B018


def test_two_programs_do_not_record_one_study(small, tmp_path):
    study = copied(small[0], tmp_path)
    with study.hold(), twin() as rig, pytest.raises(InstrumentError, match="trial"):
        run_study(rig, study)


def interrupted_at(block: int, monkeypatch):
    """Ctrl-C when that many blocks have been seen."""
    take, seen = SessionRun._block, Counter()

    def taken(self):
        seen["blocks"] += 1
        if seen["blocks"] > block:
            raise KeyboardInterrupt
        return take(self)

    monkeypatch.setattr(SessionRun, "_block", taken)


def killed_after(folder: Path, seed: int, presses: int, moment: float) -> None:
    """kill -9 in another process, `moment` seconds after so many presses."""
    context = forked.context()
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=studying.run, args=(folder, seed, there), daemon=True)
    process.start()
    there.close()
    for _ in range(presses):
        assert here.poll(60), "no press was told of"
        if here.recv() == "done":
            break
    time.sleep(moment)
    process.kill()
    process.join()


def difference(one, other) -> float:
    """Of two representatives' accelerations, relative."""
    length = min(len(one.acceleration), len(other.acceleration))
    apart = one.acceleration[:length] - other.acceleration[:length]
    return float(np.sqrt(np.mean(apart**2) / np.mean(other.acceleration[:length] ** 2)))


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_study_that_is_interrupted_again_and_again_comes_to_the_same_end(tmp_path, monkeypatch, full):
    seed = 5
    rng = np.random.default_rng(seed)
    if full:
        participants = [f"P{number:02d}" for number in range(1, 13)]
        keys = {"buttons": ["latch", "toggle", "push"], "participants": participants, "presses": 10}
        places = rng.choice(36 * 10, 10, replace=False)
    else:
        keys, places = {"participants": ["P01"], "presses": 3}, rng.choice(6, 3, replace=False)
    whole = study_in(tmp_path / "whole", **keys)
    with twin(seed=seed, bad_press_rate=0.1) as rig:
        began = time.monotonic()
        assert run_study(rig, whole)
        recorded = time.monotonic() - began
        truth = {(t.participant, t.button, t.number, t.attempt): t for t in rig.simulation.truth.presses}
    compared = whole.file.buttons if full else ("toggle",)
    began = time.monotonic()
    pressed = {button: representative(whole.recordings(button)) for button in compared}
    print(f"recorded in {recorded:.0f} s, represented in {time.monotonic() - began:.0f} s")

    broken = study_in(tmp_path / "broken", **keys)
    kills, whole_presses = 0, sum(one.of for one in whole.progress())
    for turn, place in enumerate(sorted(places)):
        left = sum(len(one.missing) for one in broken.progress())
        presses = min(max(1, int(place) - (whole_presses - left)), left)
        # Every third one is a kill; the others are Ctrl-C, in the middle of a press or between two.
        if turn % 3 == 1:
            kills += 1
            killed_after(broken.path.parent, seed, presses, float(rng.uniform(0, 0.05)))
        else:
            with monkeypatch.context() as patch, twin(seed=seed, bad_press_rate=0.1) as rig:
                # The rest takes 10 blocks, and the quickest press 18.
                interrupted_at(int(rng.integers(1, 10 + 18 * presses)), patch)
                raises(KeyboardInterrupt, "", run_study, rig, broken)
    with twin(seed=seed, bad_press_rate=0.1) as rig:
        assert run_study(rig, broken)

    assert all(entry.complete for entry in broken.progress())
    interrupted = sum(entry.interrupted for entry in broken.progress())
    # A kill may come between two sessions.
    assert len(places) - kills <= interrupted <= len(places)
    expected, found = outcome(whole), outcome(broken)
    assert len(found) == sum(entry.of for entry in broken.progress())
    assert {key: attempt for key, (attempt, _) in found.items()} == {
        key: attempt for key, (attempt, _) in expected.items()
    }
    # The presses are the same ones; what differs is the sensors' noise, and where between two samples.
    errors = [found[key][1] / expected[key][1] - 1 for key in expected]
    against = [f / truth[(*key, attempt)].activation_force - 1 for key, (attempt, f) in found.items()]
    print(f"{interrupted} interruptions; force: sd {np.std(errors):.2%}, worst {np.abs(errors).max():.2%}")
    print(f"against the truth: median {np.median(np.abs(against)):.2%}")
    assert np.median(np.abs(errors)) < 0.01
    assert np.abs(errors).max() < 0.06
    for button, press in pressed.items():
        again = representative(broken.recordings(button))
        assert again.members == press.members
        print(f"{button}: representatives differ by {difference(again, press):.1%}")
        # Aligned at the activation to a sample, which is 0.1 of a period of what the latch sheds.
        assert difference(again, press) < (0.05 if full else 0.2)
    for path in broken.folder.glob("*.h5"):
        assert verify(path) == (), path
        assert Recording.open(path).state in ("finished", "interrupted")
