"""The base of all roles' suites: capabilities, faults, deadlines, and one sentence per error."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from typing import ClassVar, Protocol, TypeVar

import pytest

from ...base.errors import ConfigurationError, DataError, HaploopError, InstrumentError, LimitError
from ..generator import Waveform
from ..interlock import Interlocked

Value = TypeVar("Value")

_KINDS = (ConfigurationError, DataError, InstrumentError, LimitError)
_SHORTEST = 20
"""Shortest message (characters) that can name the thing, the fault and the remedy."""


class Fired(Protocol):
    """A fault that counts how often it fired, as those of `haploop.mocks` do."""

    fired: int
    """Number of times that it has fired."""


class Conformance:
    """Base of a role's suite.

    A fixture and the hooks of one test share the instance, so a fixture may leave its twin or wire
    on `self` for `fault` and the rest.
    """

    optional: ClassVar[Mapping[str, str]] = {}
    """Optional capabilities of a rig, each with what its author must provide."""
    capabilities: ClassVar[Collection[str]] = ()
    """Capabilities among `optional` that this rig has."""
    faults: ClassVar[tuple[str, ...]] = ()
    """Names of faults that `fault` can inject: the driver must detect each of them."""
    deadline: ClassVar[float] = 60.0
    """Time for every call to return or raise (real s), even when the instrument misbehaves."""

    def fault(self, kind: str) -> AbstractContextManager[Fired]:
        """Inject the fault `kind` while the context lasts."""
        raise NotImplementedError(f"{type(self).__name__} names faults: give fault().")

    def in_time(self, action: Callable[[], Value]) -> Value:
        """Return or raise the outcome of `action()`; fail the test after the deadline."""
        outcome: Future[Value] = Future()

        def run() -> None:
            try:
                outcome.set_result(action())
            except BaseException as error:
                outcome.set_exception(error)

        # In a thread of its own, so that a driver that hangs fails its test and not the whole run.
        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        thread.join(self.deadline)
        if thread.is_alive():
            pytest.fail(f"still waiting after {self.deadline:g} s: every wait needs a deadline")
        return outcome.result()

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Run a test that takes `kind` once for each of `faults`."""
        if "kind" in metafunc.fixturenames:
            none = pytest.param("", marks=pytest.mark.skip(reason="this rig brings no fault about"))
            metafunc.parametrize("kind", self.faults or [none])

    @pytest.fixture(autouse=True)
    def _skip_what_is_not_offered(self, request: pytest.FixtureRequest) -> None:
        unknown = sorted(set(self.capabilities) - set(self.optional))
        if unknown:
            pytest.fail(f"there is no capability {unknown[0]!r}; there are {', '.join(self.optional)}")
        for mark in request.node.iter_markers("requires"):
            for name in mark.args:
                if name not in self.capabilities:
                    pytest.skip(f"needs {name!r}: {self.optional[name]}")


class _Bypass:
    """An interlock that authorises everything."""

    def authorise(self, *_what: object) -> None:
        pass

    def authorise_waveform(self, output: str, waveform: Waveform, starts: bool) -> None:
        pass

    def authorise_patches(self, *_what: object) -> None:
        pass

    def switched(self, *_what: object) -> None:
        pass

    def authorise_release(self) -> None:
        pass

    def authorise_renewal(self) -> None:
        pass


def bypass_interlock(driver: Interlocked) -> None:
    """Let a driver that belongs to no rig play, for a test of the driver itself: no limit is checked."""
    driver._interlock = _Bypass()


def one_sentence(text: str) -> None:
    """Assert that an error message is one line and a sentence."""
    assert "\n" not in text and text == text.strip(), f"not one line: {text!r}"
    assert len(text) >= _SHORTEST and text[-1] in ".?!", f"not a sentence: {text!r}"


@contextmanager
def refused(*kinds: type[HaploopError], naming: str = "") -> Iterator[None]:
    """Assert that the body raises one of `kinds`, in a sentence that contains `naming`."""
    try:
        yield
    except _KINDS as error:
        assert isinstance(error, kinds), f"{type(error).__name__} instead of {_names(kinds)}: {error}"
        one_sentence(str(error))
        assert naming in str(error), f"does not name {naming!r}: {error}"
    except Exception as error:
        raise AssertionError(f"{error!r} instead of {_names(kinds)}") from error
    else:
        pytest.fail(f"nothing was refused; {_names(kinds)} was promised")


def _names(kinds: Collection[type[HaploopError]]) -> str:
    return " or ".join(kind.__name__ for kind in kinds)
