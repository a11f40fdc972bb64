"""What is said of a press as soon as it is over: every bad one is marked, and no good one."""

from dataclasses import replace

import numpy as np
import pytest

from haploop.acquisition import (
    Protocol,
    Recording,
    accepted_presses,
    activation_forces,
    find_presses,
    record,
    representative,
)
from haploop.base.errors import DataError
from haploop.instruments import Press
from tests.acquisition.presses.pressworld import world_rig
from tests.raising import raises

FLAGS = {
    "soft": "no-activation",
    "hard": "saturated",
    "double": "double",
    "leaning": "not-quiet-before",
    "lingering": "not-quiet-after",
}


@pytest.mark.requires("simulation")
def test_a_clumsy_person_s_bad_presses_are_marked_and_made_again(open, tmp_path, full):
    seen: set[str] = set()
    # This seed has every flaw in its first presses.
    for seed in range(20) if full else (103,):
        rig = open(seed=seed, bad_press_rate=0.5)
        for button in ("latch", "toggle", "push", "doorbell") if full else ("latch", "push"):
            known, live = len(rig.simulation.truth.presses), []
            path = tmp_path / str(seed)
            recording = record(rig, button, "P01", 10 if full else 3, path, on_verdict=live.append)
            made = rig.simulation.truth.presses[known:]
            truth = {(press.number, press.attempt): press for press in reversed(made)}
            assert [(press.number, press.attempt) for press in live] == sorted(truth)
            for press in live:
                flaw = truth[press.number, press.attempt].flaw
                assert press.flags == ((FLAGS[flaw],) if flaw else ()), (seed, button, press)
                assert press.accepted is not bool(flaw)
                assert bool(press.reason) is bool(flaw)
                seen.add(flaw)
            assert str(recording.verdicts) == str(tuple(live))  # a nan is no nan
            assert len(recording.accepted) == len(accepted_presses(recording))
    assert seen == {"", *FLAGS}


def test_what_is_said_live_is_what_the_file_says(tmp_path):
    recording = record(world_rig(seed=8, drift=0.02, offset=20.0), "push", "P01", 4, tmp_path)
    found = find_presses(recording)
    for verdict, press in zip(recording.verdicts, found, strict=True):
        assert verdict.accepted
        assert verdict.activation == press.activation
        assert verdict.force == pytest.approx(press.force_at_activation, abs=0.002)
        assert verdict.first == pytest.approx(press.onset, abs=25)
        assert verdict.end == pytest.approx(press.release, abs=25)
    assert accepted_presses(recording) == found
    assert activation_forces(recording) == [verdict.force for verdict in recording.verdicts]
    recording.header = replace(recording.header, protocol="{}")  # as a recording without verdicts has it
    assert activation_forces(recording) == [press.force_at_activation for press in found]


def crowded(rig, **flaws):
    """Have the world's person make every attempt at a press with a flaw: `flaws` is press1="...", ..."""
    world, tell = rig.daq.world, rig.operator.tell
    volts, pushes = world.volts, []

    def told(request):
        tell(request)
        flaw = flaws.get(f"press{request.number}") if isinstance(request, Press) else None
        if flaw is None or request.attempt > 1:
            return
        at = world.presses[-1].start
        if flaw == "double":
            world.press(request.button, world.presses[-1].end + 0.02)
        elif flaw == "unsprung":
            # The finger comes back before it has left: the force stays above a newton in between.
            pushes.append((world.presses[-1].end - 0.02, 0.15, 1.0))
            world.press(request.button, world.presses[-1].end + 0.05)
        elif flaw == "touch":
            pushes.append((at - 0.12, 0.05, 0.45))
        elif flaw == "no contact":
            world.presses[-1].flips = np.zeros(0)

    def felt(channel, t):
        extra = sum(newton * ((t >= at) & (t < at + length)) for at, length, newton in pushes)
        weights = np.array(world.file.sensors.force.matrix[2])
        share = weights[int(channel[5])] / (weights @ weights) if channel.startswith("gauge") else 0.0
        return volts(channel, t) + share * extra

    rig.operator.tell, world.volts = told, felt
    return rig


@pytest.mark.parametrize(("button", "flaw", "flag", "reason"), [
    ("toggle", "double", "double", "It was pressed twice."),
    ("push", "unsprung", "double", "It was pressed twice."),
    ("toggle", "touch", "not-quiet-before", "It was touched just before."),
    ("push", "no contact", "no-activation", "The button did not switch."),
])  # fmt: skip
def test_a_bad_press_is_kept_marked_and_asked_for_again(tmp_path, button, flaw, flag, reason):
    rig = crowded(world_rig(seed=9), press2=flaw)
    told = []
    count = lambda _, done, of, __: told.append((done, of))  # noqa: E731
    recording = record(rig, button, "P01", 3, tmp_path, progress=count)
    presses = [(p.number, p.attempt, p.flags, p.reason) for p in recording.verdicts]
    assert presses == [(1, 1, (), ""), (2, 1, (flag,), reason), (2, 2, (), ""), (3, 1, (), "")]
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    asked = [r for r in rig.operator.requests if isinstance(r, Press)]
    assert str(asked[2]) == f"{reason} Press the {button} button again (2 of 3)."
    assert len(accepted_presses(recording)) == 3 < len(find_presses(recording)) + 1
    press = representative([recording])
    assert press.members == 3
    assert press.left_out == (f"P01, press 2, attempt 1: {reason}",)


def test_a_force_out_of_range_is_said_with_the_range(tmp_path):
    with pytest.raises(DataError, match=r"not accepted in 2 attempts.*switched at .* N, outside 10 to 20 N"):
        record(world_rig(seed=1), "push", "P01", 2, tmp_path, protocol=Protocol(force=(10, 20), attempts=2))
    recording = Recording.open(tmp_path / "P01-push.h5")
    assert [press.flags for press in recording.verdicts] == [("force-range",)] * 2
    assert accepted_presses(recording) == ()
    assert len(find_presses(recording)) == 2


def test_more_force_than_the_sensor_should_take_is_told_of(tmp_path):
    rig = world_rig(seed=1)
    press = rig.daq.world.press

    def strong(button, at):
        made = press(button, at)
        made.strength *= 25
        return made

    rig.daq.world.press = strong
    raises(DataError, "the sensor allows 96 N", record, rig, "push", "P01", 1, tmp_path)


def test_the_operator_rejects_the_press_before(tmp_path):
    rig = world_rig(seed=4)
    answers = iter([False] * 40 + [True] + [False] * 10_000)
    rig.operator.rejects = lambda: next(answers)
    live, told = [], []
    count = lambda _, done, of, __: told.append((done, of))  # noqa: E731
    recording = record(rig, "push", "P01", 3, tmp_path, progress=count, on_verdict=live.append)
    rejected = [press for press in live if press.flags]
    assert [press.flags for press in rejected] == [("rejected",)]
    number = rejected[0].number
    assert [(p.number, p.attempt) for p in recording.accepted if p.number == number] == [(number, 2)]
    assert len(recording.accepted) == 3
    assert told[-1] == (3, 3)
    assert (told.index((number - 1, 3)), told.count((number - 1, 3))) == (number - 1, 2)


def test_a_session_that_is_paused_waits_with_the_file_open(tmp_path):
    rig = world_rig(seed=4)
    # In blocks of 50 ms: a pause of 20 s, longer than any patience, before the second press.
    answers = iter([False] * 15 + [True] * 400 + [False] * 10_000)
    rig.operator.paused = lambda: next(answers)
    notes = iter([()] * 100 + [("Coffee.",)])
    rig.operator.notes = lambda: next(notes, ())
    recording = record(rig, "push", "P01", 3, tmp_path, protocol=Protocol(patience=5.0, pause=60.0))
    told = {event.kind: event for event in recording.events}
    assert len(recording.accepted) == 3
    begin, end = told["paused"].sample, told["resumed"].sample
    assert not any(v.first < end and v.end > begin for v in recording.accepted)
    assert end - begin == pytest.approx(20 * recording.rate_hz, rel=0.1)
    assert told["note"].text == "Coffee." and begin < told["note"].sample
    assert sum(block["count"] for block in recording.blocks) == recording.volts.shape[1]


def test_a_pause_ends_when_its_time_is_over(tmp_path):
    rig = world_rig(seed=4)
    rig.operator.paused = lambda: True
    recording = record(rig, "push", "P01", 2, tmp_path, protocol=Protocol(pause=3.0))
    events = [event for event in recording.events if event.kind in ("paused", "resumed")]
    assert [event.kind for event in events] == ["paused", "resumed"]
    assert (events[1].sample - events[0].sample) / recording.rate_hz == pytest.approx(3.0, abs=0.06)
    assert len(recording.accepted) == 2


def test_the_protocol_stands_in_the_recording(tmp_path):
    protocol = Protocol(force=(1, 9), linger=0.3)
    recording = record(world_rig(), "push", "P01", 1, tmp_path, protocol=protocol)
    assert Protocol.from_json(recording.header.protocol) == protocol
    assert Protocol.from_json("{}") is None
    raises(DataError, "update haploop", Protocol.from_json, '{"telepathy": true, "segmentation": {}}')
