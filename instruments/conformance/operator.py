"""Promises of the operator role."""

from __future__ import annotations

import pytest

from ..operator import Aim, ConfirmSettings, Consent, Operator, Press, Ready, Request, Rest, Touch
from .suite import Conformance

_REQUESTS = (
    Press(button="latch", participant="P01", number=1, of=1),
    Rest(duration=0.1),
    Consent(participant="P01"),
    Ready(participant="P01", button="latch", presses=1),
    Aim(point="button"),
    Touch(participant="P01", pressure="light", number=1, of=1),
    ConfirmSettings("Is the range 20 mm/s?"),
)


class OperatorConformance(Conformance):
    """Give a fixture `operator`: a person, or a script in their place, who confirms everything."""

    @pytest.mark.parametrize("asked", _REQUESTS, ids=lambda request: type(request).__name__)
    def test_is_told_of_anything_and_returns(self, operator: Operator, asked: Request) -> None:
        """`tell` takes every kind of request and does not wait for the person."""
        self.in_time(lambda: operator.tell(asked))

    @pytest.mark.parametrize("asked", _REQUESTS, ids=lambda request: type(request).__name__)
    def test_answers_yes_or_no(self, operator: Operator, asked: Request) -> None:
        """`confirm` takes every kind of request and returns a bool, here yes."""
        assert self.in_time(lambda: operator.confirm(asked)) is True

    def test_rejects_without_being_waited_for(self, operator: Operator) -> None:
        """`rejects` returns at once, here False."""
        assert self.in_time(operator.rejects) is False

    def test_neither_pauses_nor_notes_by_itself(self, operator: Operator) -> None:
        """`paused` and `notes` return at once, here False and nothing."""
        assert self.in_time(operator.paused) is False
        assert list(self.in_time(operator.notes)) == []
