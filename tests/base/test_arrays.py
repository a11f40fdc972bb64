from types import GenericAlias

import numpy as np

from haploop.base import arrays


def test_the_scalar_of_a_hint(monkeypatch):
    assert arrays.scalar_of(arrays.FloatArray) is np.float64
    assert arrays.scalar_of(arrays.ComplexArray) is np.complex128
    assert arrays.scalar_of(float) is arrays.scalar_of(tuple[int, ...]) is arrays.scalar_of(None) is None


def test_the_scalar_of_a_hint_whose_alias_has_a_name(monkeypatch):
    """numpy 2.5's NDArray[x], whichever numpy is installed."""

    class Alias:
        pass

    monkeypatch.setattr(arrays, "FloatArray", GenericAlias(Alias, (np.float64,)))
    assert arrays.scalar_of(GenericAlias(Alias, (np.bool_,))) is np.bool_
    assert arrays.scalar_of(np.ndarray) is None
