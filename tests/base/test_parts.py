"""Arrays that are made part by part: the same samples as at once, and few parts at a time."""

import numpy as np
import pytest

from haploop.base.parts import PART, Parted, carried

SAMPLES = 3 * PART + 10


@pytest.fixture
def asked() -> list[slice]:
    return []


@pytest.fixture
def parted(asked: list[slice]) -> Parted:
    def make(part: slice) -> np.ndarray:
        asked.append(part)
        return np.array([[1], [-1]]) * np.arange(part.start, part.stop)

    return Parted((2, SAMPLES), np.int64, make)


@pytest.mark.parametrize("within", [(0, 0), (0, 1), (5, PART), (PART - 1, PART + 1), (3, SAMPLES), (7, 5)])
def test_any_samples_are_those_of_the_whole(within, parted):
    whole, part = np.array([[1], [-1]]) * np.arange(SAMPLES), slice(*within)
    np.testing.assert_array_equal(parted[part], whole[:, part])
    np.testing.assert_array_equal(parted[1, part], whole[1, part])
    np.testing.assert_array_equal(parted.until(PART + 3)[:, part], whole[:, : PART + 3][:, part])
    np.testing.assert_array_equal(parted, whole)
    np.testing.assert_array_equal(parted[part], whole[:, part])
    assert len(parted) == SAMPLES and parted.shape == whole.shape


def test_a_part_is_made_when_it_is_asked_for_and_kept_for_a_while(parted, asked):
    for _ in range(3):
        assert parted[:, PART : PART + 5].shape == (2, 5)
    assert asked == [slice(PART, 2 * PART)]
    assert list(parted.parts()) == [
        *(slice(n * PART, (n + 1) * PART) for n in range(3)),
        slice(3 * PART, SAMPLES),
    ]


def test_an_array_in_memory_and_an_empty_one():
    array = np.arange(6).reshape(2, 3)
    found = Parted.of(array)
    assert found[:] is not None and np.array_equal(found[0, 1:], [1, 2]) and not found.until(0)[:].size
    assert Parted((2, 0), np.int16, lambda part: array[:, :0])[:].shape == (2, 0)


def test_a_filter_with_a_memory_gives_the_same_in_any_order():
    class Sum:
        """The sum of all samples so far."""

        before = 0.0

        def __call__(self, signal: np.ndarray) -> np.ndarray:
            found = self.before + np.cumsum(signal)
            self.before = float(found[-1])
            return found

    signal = np.random.default_rng(1).integers(-9, 9, SAMPLES).astype(float)
    found, whole = carried(Parted.of(signal), Sum()), np.cumsum(signal)
    for begin in (2 * PART, 0, 3 * PART + 2, PART - 1, 5):
        np.testing.assert_array_equal(found[begin : begin + 9], whole[begin : begin + 9])
    np.testing.assert_array_equal(found, whole)
