"""The clock of a simulated rig with a person in front of it."""

from pytest import approx, fixture

from haploop.base import clock as clocks
from haploop.base.clock import RealTimeClock


class Wall:
    def __init__(self) -> None:
        self.time = 100.0
        self.slept: list[float] = []

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        self.slept.append(max(0.0, duration))
        self.time += max(0.0, duration)


@fixture
def wall(monkeypatch):
    wall = Wall()
    monkeypatch.setattr(clocks, "RealClock", lambda: wall)
    return wall


def test_simulated_time_passes_no_faster_than_real_time(wall):
    clock = RealTimeClock()
    for _ in range(20):
        wall.time += 0.03  # the work of one block
        clock.sleep(0.05)
    assert (clock.now(), wall.time) == (approx(1.0), approx(101.0))
    clock.sleep_until(3.0)
    assert (clock.now(), wall.time) == (approx(3.0), approx(103.0))


def test_time_in_which_nothing_waited_is_left_out(wall):
    clock = RealTimeClock()
    clock.sleep(0.05)
    wall.time += 30.0  # somebody thinks about a question
    clock.sleep(0.05)
    assert clock.now() == approx(0.1)
    assert wall.slept[-1] == 0.0
    clock.sleep(0.05)
    assert wall.slept[-1] == approx(0.05)
