"""Rows, codes and headers by hand: every byte of them, and what is no row."""

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from haploop.acquisition.recording import file_format
from haploop.acquisition.recording.rows import (
    BLOCK,
    EVENT,
    FLAGS,
    VERDICT,
    Event,
    PressVerdict,
    block_dtype,
    event_row,
    events_in,
    finished_row,
    samples_crc,
    sealed,
    verdict_row,
    verdicts_in,
    whole,
)
from haploop.base.errors import ConfigurationError, DataError
from tests.raising import raises

PRESS = PressVerdict(2, 3, 100, 250, 112.5, 2.25, True, (), "")


def test_the_sizes_of_rows_are_those_of_the_format():
    assert (EVENT.itemsize, VERDICT.itemsize, BLOCK.itemsize) == (256, 256, 32)
    assert block_dtype(3, 50).itemsize == 8 + 4 + 4 + 8 + 2 * 3 * 50 + 4


def test_an_event_comes_back_and_a_long_text_is_cut_between_characters():
    raw = event_row(Event(-5, "note", "µ" * 200))
    (row,) = np.frombuffer(raw, EVENT)
    assert whole(row) and int(row["crc"]) == zlib.crc32(raw[:-4])
    assert events_in(np.frombuffer(raw, EVENT)) == (Event(-5, "note", "µ" * 114),)
    (odd,) = events_in(np.frombuffer(event_row(Event(0, "x" * 20, "a" + "µ" * 200)), EVENT))
    assert odd == Event(0, "x" * 16, "a" + "µ" * 113)
    (cut,) = events_in(np.frombuffer(event_row(Event(0, "x" * 15 + "µ", "")), EVENT))
    assert cut.kind == "x" * 15


def test_a_verdict_comes_back_with_every_flag():
    for number in range(len(FLAGS)):
        press = PRESS._replace(flags=FLAGS[: number + 1], accepted=False, reason="€" * 80)
        (found,) = verdicts_in(np.frombuffer(verdict_row(press), VERDICT))
        assert found == press._replace(reason="€" * 66)
        (row,) = np.frombuffer(verdict_row(press), VERDICT)
        assert int(row["flags"]) == 2 ** (number + 1) - 1 and whole(row)
    twice = PRESS._replace(flags=("double", "double"))
    assert verdicts_in(np.frombuffer(verdict_row(twice), VERDICT))[0].flags == ("double",)


def test_the_last_verdict_on_an_attempt_counts_and_they_are_sorted():
    presses = [
        PRESS._replace(number=2, attempt=1, reason="first"),
        PRESS._replace(number=1, attempt=2),
        PRESS._replace(number=1, attempt=1),
        PRESS._replace(number=2, attempt=1, reason="last", accepted=False),
    ]
    rows = np.frombuffer(b"".join(map(verdict_row, presses)), VERDICT)
    assert verdicts_in(rows) == (presses[2], presses[1], presses[3])


@pytest.mark.parametrize("change", [
    {"number": 0}, {"attempt": 0}, {"first": -1}, {"first": 251}, {"flags": ("nothing",)},
])  # fmt: skip
def test_a_verdict_without_sense_is_refused(change):
    raises(DataError, "", verdict_row, PRESS._replace(**change))
    with pytest.raises(DataError, match="no press flag 'nothing'"):
        verdict_row(PRESS._replace(flags=("double", "nothing", "never")))
    verdict_row(PRESS._replace(number=1, attempt=1, first=0, end=0))
    verdict_row(PRESS._replace(first=250))


def test_a_row_that_was_not_written_is_none():
    assert not whole(np.zeros(1, EVENT)[0])
    raw = bytearray(event_row(Event(1, "note", "text")))
    for place in (0, 100, 255):
        raw[place] ^= 1
        assert not whole(np.frombuffer(bytes(raw), EVENT)[0])
        raw[place] ^= 1


def test_a_finished_row_has_the_crc_of_the_filled_samples_only():
    record = np.zeros(1, block_dtype(2, 5))[0]
    record["first"], record["count"], record["overload"], record["time"] = 7, 3, 2, 0.25
    record["samples"] = np.arange(10).reshape(2, 5)
    row = finished_row(record)
    assert row.tolist()[0][:4] == (7, 3, 2, 0.25) and whole(row[0])
    codes = np.array([[0, 1, 2], [5, 6, 7]], "<i2")
    assert int(row["samples_crc"][0]) == samples_crc(codes) == zlib.crc32(codes.tobytes())
    assert sealed(row) == row.tobytes()


def test_codes_are_the_nearest_and_end_at_full_scale():
    full = np.array([10.0, 2.0, 1.0])
    step = full / file_format.CODES
    volts = np.array([[-10.0, 0.0, 10.0 - step[0]], [0.49 * step[1], 0.51 * step[1], -1.5], [0.0, 0.0, 0.0]])
    codes, beyond = file_format.to_codes(volts, full)
    assert codes.tolist() == [[-32768, 0, 32767], [0, 1, -24576], [0, 0, 0]] and not beyond.any()
    np.testing.assert_array_equal(file_format.from_codes(codes, full), codes * step[:, None])
    for row, value, code in ((0, 10.0, 32767), (1, -2.0002, -32768), (2, np.nan, -32768), (0, 1e300, 32767)):
        changed = volts.copy()
        changed[row, 1] = value
        with np.errstate(over="ignore"):
            codes, beyond = file_format.to_codes(changed, full)
        assert codes[row, 1] == code and beyond.tolist() == [row == k for k in range(3)]


_REACH = st.floats(-3.0, 3.0, width=64)
_ODD = st.sampled_from([0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324])
_HALF = st.integers(-2 * file_format.CODES - 5, 2 * file_format.CODES + 5).map(
    lambda half: half / (2 * file_format.CODES)
)


@given(arrays(np.float64, (3, 7), elements=st.one_of(_REACH, _ODD, _HALF)), st.integers(0, 7))
def test_codes_are_the_same_bits_as_the_formula_one_channel_after_the_other(volts, count):
    full = np.array([10.0, 5.0, 0.2])
    volts = volts[:, :count] * full[:, None]
    codes, scratch = np.full((3, 7), 99, np.int16), np.empty((3, 7), np.float32)
    with np.errstate(over="ignore"):
        beyond = file_format.convert(
            volts, file_format.codes_per_volt(full), codes[:, :count], scratch[:, :count]
        )
        for row in range(3):
            exact = np.rint(volts[row].astype(np.float32) * np.float32(file_format.CODES / full[row]))
            within = (exact >= -file_format.CODES) & (exact <= file_format.CODES - 1)  # NaN is not
            assert beyond[row] == (not within.all())
            clipped = np.clip(
                np.nan_to_num(exact, nan=-file_format.CODES), -file_format.CODES, file_format.CODES - 1
            )
            assert codes[row, :count].tolist() == clipped.tolist()
    assert np.all(codes[:, count:] == 99)


@pytest.mark.parametrize(("participant", "button", "allowed"), [
    ("P01", "latch", True), ("abcd1234", "a" * 40, True), ("P1", "0-_", True), ("abcde1", "latch", False),
    ("P12345", "latch", False), ("01", "latch", False), ("P", "latch", False), ("P01 ", "latch", False),
    ("P01", "a" * 41, False), ("P01", "-a", False), ("P01", "_a", False), ("P01", "", False),
    ("P01", "a/b", False), ("P01", "a.b", False), ("P01\n", "latch", False), ("../P01", "latch", False),
    ("P 01", "latch", False), ("Anna", "latch", False), ("P01\\x", "latch", False), ("", "latch", False),
    ("P01", "..", False), ("P01", "a\\b", False), ("P01", "a b", False), ("P01", "push\n", False),
    ("P01", "C:", False), ("01P", "latch", False),
])  # fmt: skip
def test_names_of_files(participant, button, allowed):
    if allowed:
        assert file_format.file_name(participant, button) == f"{participant}-{button}.h5"
    else:
        raises(ConfigurationError, "is not a valid", file_format.file_name, participant, button)
