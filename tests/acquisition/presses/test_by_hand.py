"""Presses of straight lines and steps, whose every index is known by hand: 1000 samples/s, no noise."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.signal

from haploop.acquisition.presses.pressing import shaken
from haploop.acquisition.presses.quality import _times
from haploop.acquisition.presses.segmentation import Detector, Span, _first_lasting, find_presses
from haploop.acquisition.presses.segmentation_settings import Segmentation
from haploop.base.parts import Parted
from haploop.instruments import load_rig_file

RATE = 1000.0


def trapezoid(length: int, first: int, rise: int, hold: int, peak: float) -> np.ndarray:
    """Zero until `first`, then up in `rise` samples, `hold` samples at `peak`, and down as steeply."""
    t = np.arange(length) - first
    return peak * np.clip(np.minimum(t / rise, (2 * rise + hold - t) / rise), 0, 1)


def recording(
    force: np.ndarray,
    changes: Any = (),
    clicks: dict[int, float] | None = None,
    delays: dict[str, float] | None = None,
) -> Any:
    """`changes` are the samples at which the contact changes; `clicks` have a height each; `delays` in s."""
    contact = np.zeros(len(force))
    for change in changes:
        contact[change:] = 1 - contact[change:]
    vertical = np.full(len(force), 9.81)
    for at, height in (clicks or {}).items():
        vertical[at] += height
    found = SimpleNamespace(
        button="push", rate_hz=RATE, measured_hz=RATE, force=force, activation=contact, vertical=vertical,
        motion="acceleration", sensors=load_rig_file("simulated").sensors, quiet=slice(0, 1),
        has=lambda name: name in ("force", "acceleration", "activation"),
        saturated=np.zeros(len(force), bool), delay=lambda name: (delays or {}).get(name, 0.0),
    )  # fmt: skip
    found.in_parts = lambda name: Parted.of(getattr(found, name))
    return found


# The detector


@pytest.mark.parametrize("block", [1, 3, 5, 7, 100, 5000])
def test_a_detector_finds_the_same_in_blocks_of_any_size(block):
    force = np.zeros(4000)
    for first, stop, newton in ((1000, 1400, 2.0), (1900, 2300, 0.5), (2380, 2400, 1.0), (2900, 3000, 0.49)):
        force[first:stop] = newton
    detector = Detector(RATE)
    pressing = []
    for at in range(0, len(force), block):
        detector.feed(force[at : at + block])
        pressing.append(detector.pressing)
    # 80 samples without the finger do not end a press; 0.49 N are a touch; 0.5 N are a press.
    assert detector.spans == [Span(1000, 1400, 0.0), Span(1900, 2400, 0.0)]
    assert not detector.pressing
    if block == 5:  # it has ended when 0.1 s have passed
        assert [5 * n for n in range(1, len(pressing)) if pressing[n] != pressing[n - 1]] == [
            1000, 1495, 1900, 2495, 2900, 3095,
        ]  # fmt: skip


def test_a_press_ends_with_the_signal_and_a_touch_does_not_begin_one():
    for newton, spans in ((0.31, []), (0.5, [Span(500, 600, 0.0)])):
        detector = Detector(RATE)
        detector.feed(np.concatenate([np.zeros(500), np.full(100, newton)]))
        assert detector.pressing and not detector.spans
        detector.finish()
        detector.finish()
        assert detector.spans == spans and not detector.pressing
    detector = Detector(RATE)
    detector.feed(np.full(500, 0.30))
    assert not detector.pressing
    after = Detector(RATE)  # the peak of one is not the next one's
    after.feed(np.concatenate([np.full(100, 2.0), np.zeros(200), np.full(100, 0.4), np.zeros(200)]))
    assert after.spans == [Span(0, 100, 0.0)]


@pytest.mark.parametrize(("newton", "share"), [(0.10, 1.0), (-0.4, 1.0), (0.20, 1 / 3)])
def test_the_rest_is_followed_and_a_resting_hand_more_slowly(newton, share):
    detector = Detector(RATE)
    detector.feed(np.full(50, newton))  # ten bins of 5 samples
    expected = 0.0
    for _ in range(10):
        expected += (newton - expected) * 0.005 * share
    detector.feed(np.full(20, newton + 2.0))
    detector.finish()
    ((first, end, rest),) = detector.spans
    assert (first, end) == (50, 70) and rest == pytest.approx(expected, rel=1e-12)


# Whole recordings


def test_every_index_of_two_presses():
    force = trapezoid(4000, 1000, 100, 300, 2.0) + trapezoid(4000, 2000, 200, 200, 4.0)
    found = find_presses(recording(force, (1060, 1440, 2150, 2450)), Segmentation(least_peak=1.0))
    one, two = found
    # 0.02 N a sample: 0.06 N above the rest after the third; the average over 5 samples is the same line.
    assert (one.onset, one.release) == (1003, 1495)
    assert (two.onset, two.release) == (2003, 2595)
    # A quarter of a second before and after, and no neighbour's half.
    assert (one.start, one.stop) == (753, 1745)
    assert (two.start, two.stop) == (1753, 2845)
    assert one.peak in range(1100, 1105) and two.peak in range(2200, 2205)
    assert (one.activation, one.opened) == (1059.5, 1439.5)
    assert (two.activation, two.opened) == (2149.5, 2449.5)
    assert one.force_at_activation == pytest.approx(0.02 * 59.5, abs=1e-9)
    assert two.force_at_activation == pytest.approx(0.02 * 149.5, abs=1e-9)
    assert not one.saturated and one.first_stage is None
    assert find_presses(recording(np.zeros(0))) == () == find_presses(recording(np.zeros(500)))


def test_close_neighbours_share_the_time_between_them():
    force = trapezoid(2500, 500, 50, 300, 2.0) + trapezoid(2500, 1100, 50, 300, 2.0)
    one, two = find_presses(recording(force))
    # For the detector, the first ends at 895 and the second begins at 1110: bins of five samples.
    assert (one.onset, one.release, two.onset, two.release) == (502, 897, 1102, 1497)
    assert (one.start, one.stop) == (252, (897 + 1110) // 2)
    assert (two.start, two.stop) == ((895 + 1102) // 2, 1747)
    edge = find_presses(recording(trapezoid(520, 100, 50, 300, 2.0)))[0]
    assert (edge.start, edge.stop) == (0, 520)


def test_the_delays_of_the_channels_are_taken_into_account():
    force = trapezoid(2000, 500, 100, 300, 2.0)
    found = find_presses(recording(force, (560,), delays={"activation": 0.002, "force": 0.010}))[0]
    assert found.activation == pytest.approx(561.5) and found.opened is None
    # The force that was sampled at the instant: 10 samples earlier in the file.
    assert found.force_at_activation == pytest.approx(0.02 * 51.5, abs=1e-9)
    assert find_presses(recording(force))[0].activation is None
    assert find_presses(recording(force))[0].force_at_activation is None


def test_a_press_without_a_beginning_or_an_end():
    pressed = np.full(1000, 2.0)
    for changes, activation in (((1,), 0.5), ((0, 1), 0.5), ((500,), 499.5), ((0, 500), 499.5)):
        (press,) = find_presses(recording(pressed, changes))
        assert (press.start, press.onset, press.release, press.stop) == (0, 0, 999, 1000)
        assert press.activation == activation


def test_a_contact_that_is_closed_at_rest_and_bounces_switches_once():
    force = trapezoid(2000, 500, 100, 300, 2.0)
    # Closed at rest; open from 560 on, with bounces of two samples; closed again at 850.
    bounced = recording(force, (0, 556, 558, 560, 850))
    found = find_presses(bounced)[0]
    assert (found.activation, found.opened) == (555.5, 849.5)
    # Three samples are no change.
    assert find_presses(recording(force, (560, 562)))[0].activation is None


def test_a_saturated_sample_counts_within_the_press_only():
    force = trapezoid(2000, 500, 100, 300, 2.0)
    press = find_presses(recording(force))[0]
    first, last = press.onset, press.release
    for at, said in ((first - 1, False), (first, True), (last, True), (last + 1, False)):
        one = recording(force)
        one.saturated[at] = True
        assert find_presses(one)[0].saturated is said


@pytest.mark.parametrize(("clicks", "expected"), [
    ({700: 10.0}, None),  # the main click alone
    ({700: 10.0, 640: 4.0}, 639.5),
    ({700: 10.0, 640: 4.0, 660: 3.0}, 639.5),
    ({700: 10.0, 640: 1.0}, None),  # too small beside the main one
    ({700: 10.0, 694: 4.0}, None),  # a part of it
    ({700: 10.0, 520: 4.0}, None),  # at too little force
    ({700: 10.0, 640: 4.0, 400: 30.0}, None),  # as it moves at rest
    ({640: 4.0}, 639.5),
])  # fmt: skip
def test_a_first_click_is_found_where_it_begins(clicks, expected):
    force = trapezoid(2000, 500, 200, 300, 4.0)
    found = find_presses(recording(force, (700,), clicks))[0]
    assert found.activation == 699.5 and found.first_stage == expected
    late = find_presses(recording(force, (700,), clicks, {"acceleration": 0.003}))[0]
    assert late.first_stage == (None if expected is None else pytest.approx(expected + 3))


def test_a_first_click_is_looked_for_from_the_first_sample_with_enough_force_above_the_rest():
    """0.02 N a sample from 500 on: a quarter of the 2.79 N at 640 is exceeded at 535, from any rest."""
    for rest in (0.0, 0.2):
        force = rest + trapezoid(2000, 500, 200, 300, 4.0)
        for at, found in ((525, None), (534, 534.5), (535, 534.5), (536, 535.5)):
            (press,) = find_presses(recording(force, (640,), {640: 10.0, at: 8.0}))
            assert press.first_stage == found


def test_what_the_hand_does_is_removed_by_a_butterworth_filter_of_60_hz():
    rng = np.random.default_rng(0)
    moved = recording(np.zeros(500), clicks={n: float(rng.normal()) for n in range(1, 500)})
    sections = scipy.signal.butter(2, 60.0, "high", fs=RATE, output="sos")
    filtered = np.abs(scipy.signal.sosfilt(sections, moved.vertical - 9.81))
    found = shaken(moved.in_parts("vertical"), RATE, 60.0)[:]
    assert found == pytest.approx(filtered, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("change", "samples"), [(560, range(558, 562)), (2, range(4))])
def test_the_force_at_an_instant_is_of_every_sample_within_reach(change, samples):
    """Two lines that meet at the instant, through samples that lie on no line."""
    force = trapezoid(2000, 500, 100, 300, 2.0) if change > 500 else np.full(500, 2.0)
    force[samples] += (0.01, 0.0, 0.0, 0.02)
    t = np.array([-1.5, -0.5, 0.5, 1.5])
    lines = np.stack([np.ones(4), np.minimum(t, 0), np.maximum(t, 0)], axis=1)
    true = np.linalg.lstsq(lines, force[samples], rcond=None)[0][0]
    assert find_presses(recording(force, (change,)))[0].force_at_activation == pytest.approx(true, abs=1e-9)


@pytest.mark.parametrize(("state", "first"), [
    ("11100000", 0),
    ("11000000", None),
    ("00111000", 2),
    ("10000111", 0),
    ("100000111", 6),
    ("00000001", 7),
    ("0101011", 1),
])  # fmt: skip
def test_a_state_lasts_when_it_holds_for_most_of_five_samples(state, first):
    assert _first_lasting(np.array([c == "1" for c in state]), 0, 5) == first


def test_a_force_is_above_the_rest_just_before_its_press():
    # Between two presses the rest has risen by 0.1 N, which the detector follows in a second.
    force = trapezoid(3000, 500, 100, 300, 2.0) + trapezoid(3000, 1500, 100, 300, 2.0)
    force[1000:] += 0.1
    one, two = find_presses(recording(force, (560, 1560)))
    assert one.force_at_activation == pytest.approx(0.02 * 59.5, abs=1e-9)
    assert two.force_at_activation == pytest.approx(0.02 * 59.5, abs=1e-9)
    # 40 samples of rest are too few for a mean: what the detector has followed is taken.
    early = 0.1 + trapezoid(1000, 40, 100, 300, 2.0)
    ((first, _, rest),) = spans_of(early)
    (press,) = find_presses(recording(early, (100,)))
    assert 0 < rest < 0.01 and first == 50
    assert press.force_at_activation == pytest.approx(0.1 - rest + 0.02 * 59.5, abs=1e-9)


def spans_of(force: np.ndarray) -> list[Span]:
    detector = Detector(RATE)
    detector.feed(force)
    detector.finish()
    return detector.spans


# How often a button was pressed


@pytest.mark.parametrize(("force", "times"), [
    ([0, 10, 0], 1),
    ([0, 2.9, 0.5, 10, 0], 1),  # before the press a touch, of less than 0.3 of it
    ([0, 3.1, 0.5, 10, 0], 2),
    ([0, 10, 1, 2.9, 0], 1),  # after it
    ([0, 10, 1, 3.0, 0], 1),
    ([0, 10, 1, 3.1, 0], 2),
    ([0, 10, 3.4, 10, 0], 2),
    ([0, 10, 3.6, 10, 0], 1),  # the finger has not left it, at more than 0.35
    ([0, 10, 0, 10, 0, 10], 3),
])  # fmt: skip
def test_a_second_press_has_a_third_of_the_force_and_a_fall_before_it(force, times):
    assert _times(np.array(force, dtype=float)) == times
