"""Power by simulation: nominal without an effect, rising with people, and a wrong plan."""

from pathlib import Path

import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.experiments.analysis.power import load_power_plan, power_of
from tests.raising import raises

PLAN = """
people = [{people}]
trials = 10
[correct.I.none]
latch = 0.75
toggle = {toggle}
push = 0.75
[correct.I.given]
latch = {given}
toggle = {given}
push = {given}
[correct.II.none]
latch = 0.75
toggle = 0.75
push = 0.75
[correct.II.given]
latch = {given}
toggle = {given}
push = {given}
"""


def plan(folder: Path, people: str = "12", given: float = 0.75, toggle: float = 0.75) -> Path:
    path = folder / "plan.toml"
    path.write_text(PLAN.format(people=people, given=given, toggle=toggle), encoding="utf-8")
    return path


def test_without_an_effect_power_is_alpha(tmp_path, full):
    runs = 2000 if full else 60
    found = power_of(load_power_plan(plan(tmp_path)), runs=runs, seed=3)
    assert len(found) == 7
    for one in found:
        assert one.interval[0] <= 0.06 and one.power <= (0.08 if full else 0.2), one


def test_power_rises_with_people(tmp_path):
    found = power_of(load_power_plan(plan(tmp_path, "6, 24", given=0.85)), runs=30, seed=1)
    few, many = (one.power for one in found if one.effect == "confirmation")
    assert few < many and many > 0.8
    assert found == power_of(load_power_plan(plan(tmp_path, "6, 24", given=0.85)), runs=30, seed=1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("trials = 10", "trials = 0"), "trials"),
        (("toggle = 0.75\npush = 0.75\n[correct.II.given]", "[correct.II.given]"), "same classes"),
        (("[correct.II.given]", "[correct.II.other]"), "same sessions"),
        (("trials = 10", "trials = 10\nspred = 1"), "spred"),
        (("latch = 0.75", "latch = 1.0"), "correct"),
        (("trials = 10", "trials = "), "not valid TOML"),
    ],
)
def test_a_wrong_plan_is_refused(tmp_path, change, said):
    path = plan(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace(*change), encoding="utf-8")
    raises(ConfigurationError, said, load_power_plan, path)
    raises(ConfigurationError, "no file", load_power_plan, tmp_path / "none.toml")


def test_too_few_people_are_refused(tmp_path):
    raises(DataError, "too few", power_of, load_power_plan(plan(tmp_path, "3")), runs=10)
