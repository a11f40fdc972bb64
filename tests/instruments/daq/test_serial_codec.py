"""Frames of a board: whatever way the bytes are cut, and whatever happens to some of them."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haploop.base.errors import ConfigurationError
from haploop.base.validation import validate
from haploop.instruments.daq.serial_codec import Decoder, Framing

FRAMINGS: dict[str, dict[str, Any]] = {
    "comma": {"separator": ",", "columns": 3},
    "blanks": {"separator": " ", "columns": 3},
    "plain": {"struct": "<hhh", "sync": "AA55"},
    "summed": {"struct": "<hiB", "sync": "AA55", "checksum": "sum8"},
    "xored": {"struct": ">3h", "sync": "7E", "checksum": "xor8"},
    "crc": {"struct": "<hfH", "sync": "AA55", "checksum": "crc16"},
}


def cut(data: bytes, sizes: list[int]) -> list[bytes]:
    parts, at = [], 0
    for size in sizes:
        parts.append(data[at : at + size])
        at += size
    return [*parts, data[at:]]


@pytest.mark.parametrize("name", FRAMINGS)
@given(
    rows=st.lists(st.tuples(st.integers(-9000, 9000), st.integers(0, 9000), st.integers(0, 200)), min_size=2),
    sizes=st.lists(st.integers(0, 9), max_size=40),
)
def test_what_is_sent_is_received(name, rows, sizes):
    framing = Framing.model_validate(FRAMINGS[name])
    decoder = Decoder(framing)
    # The first line may have lost its beginning: it belongs to no frame.
    text = framing.struct is None
    data = (b"12" if text else b"") + b"".join(framing.encode(row) for row in rows)
    if not text:
        data += bytes.fromhex(framing.sync)  # of the next frame
    frames = [frame for part in cut(data, sizes) for frame in decoder.feed(part)]
    assert frames == [tuple(map(float, row)) for row in rows[1 if text else 0 :]]


@pytest.mark.parametrize("name", ["comma", "blanks", "summed", "xored", "crc"])
@given(
    which=st.integers(3, 15),
    flip=st.integers(1, 255),
    at=st.integers(0, 30),
    sizes=st.lists(st.integers(1, 9), max_size=60),
)
def test_a_damaged_frame_costs_itself(name, which, flip, at, sizes):
    """Any byte of any frame: at most two frames are damaged, and none is another number than was sent."""
    framing = Framing.model_validate(FRAMINGS[name])
    rows = [(11 * k, 7 * k, k) for k in range(1, 21)]
    sent = [framing.encode(row) for row in rows]
    body = bytearray(sent[which])
    if framing.struct is None:
        # A flipped digit is another digit: text without a checksum cannot tell. Letters are told.
        body[at % (len(body) - 1)] = ord("x")
    else:
        body[at % len(body)] ^= flip
    sent[which] = bytes(body)
    decoder = Decoder(framing)
    data = b"".join(sent) + (b"" if framing.struct is None else bytes.fromhex(framing.sync))
    frames = [frame for part in cut(data, sizes) for frame in decoder.feed(part)]
    expected = [tuple(map(float, row)) for row in rows]
    assert set(frames) <= {None, *expected}
    lost = [frame for frame in expected[1:] if frame not in frames]
    assert 1 <= len(lost) <= 2 and frames.count(None) >= 1
    assert abs(len(frames) - len(expected)) <= 1


def test_noise_is_no_sample_and_comments_are_none():
    text = Decoder(Framing(separator=",", columns=2))
    begun = text.feed(b"boot 3.1\n# gain 128\n1,2\n\n3,4\r\n# zeroed\n5,6\n")
    assert begun == [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]
    assert text.feed(b"1,2,3\n7\nnan,1\n1e999,2\n8,9\n") == [None, None, None, None, (8.0, 9.0)]
    assert text.feed(bytes(5000)) == [None] and text.feed(b"\n1,2\n")[-1] == (1.0, 2.0)
    binary = Decoder(Framing(struct="<hh", sync="AA55", checksum="sum8"))
    rng = np.random.default_rng(3)
    frames = binary.feed(rng.integers(0, 256, 20_000, dtype=np.uint8).tobytes())
    assert not [frame for frame in frames if frame is not None]


@pytest.mark.parametrize(("table", "says"), [
    ({}, "write either separator and columns, for lines of text, or struct and sync"),
    ({"separator": ",", "struct": "<h"}, "write either separator and columns"),
    ({"separator": ","}, "separator needs columns"),
    ({"separator": ",", "columns": 0}, "columns must be 1 or more"),
    ({"separator": ", ", "columns": 2}, "separator must be one character"),
    ({"separator": ",", "columns": 2, "sync": "AA"}, "sync and checksum are of binary frames"),
    ({"struct": "<h"}, "binary frames need sync"),
    ({"struct": "<h", "sync": "XY"}, "sync 'XY' must be bytes in hexadecimal"),
    ({"struct": "hh", "sync": "AA"}, "must begin with < or >"),
    ({"struct": "<zz", "sync": "AA"}, "is none of Python's struct module"),
    ({"struct": "<4s", "sync": "AA"}, "have numbers only"),
    ({"struct": "<hh", "sync": "AA", "columns": 3}, "has 2 columns: leave columns out"),
    ({"struct": "<hh", "sync": "AA", "checksum": "md5"}, "checksum must be 'none', 'sum8'"),
    ({"seperator": ","}, "unknown key 'seperator'; did you mean 'separator'"),
])  # fmt: skip
def test_a_wrong_framing_is_one_sentence(table, says):
    with pytest.raises(ConfigurationError, match=says) as refused:
        validate(Framing, table, "[adc] of lab.toml")
    assert "\n" not in str(refused.value) and str(refused.value)[-1] in ".?"
