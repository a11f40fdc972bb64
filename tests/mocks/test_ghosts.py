"""A source of high impedance behind a multiplexer shows the channel before it, and the doctor finds it."""

import pytest

import haploop
from haploop.calibration.self_test.loop_test import check_ghosts


@pytest.mark.parametrize(("farad", "shown"), [(0.0, 1.3e-2), (1e-7, 1.6e-2)])
def test_the_doctor_finds_a_source_that_does_not_settle(open, farad, shown):
    fault = {"kind": "source-impedance", "channel": "acceleration_x", "ohm": 32e3, "farad": farad}
    rig = open("haptable", faults=[fault])
    order = ("switch", "acceleration_x", "acceleration_y")
    (finding,) = check_ghosts(rig, [order])
    assert finding.status == "yellow"
    assert finding.name == "Ghost in acceleration_x"
    assert "ai_conv_rate" in finding.sentence
    percent = float(finding.sentence.partition(" shows ")[2].partition("%")[0])
    assert percent / 100 == pytest.approx(shown, rel=0.15)
    assert [fault.fired for fault in rig.simulation.faults] == [1]


def test_sources_that_settle_show_no_ghost(open):
    assert not list(check_ghosts(open("haptable"), [("switch", "acceleration_x", "drive")]))


@pytest.mark.long
@pytest.mark.parametrize("simulate", ["twin", "wire"])
def test_slower_conversions_cure_it(tmp_path, simulate):
    fault = {"kind": "source-impedance", "channel": "acceleration_x"}
    slow = tmp_path / "slow.toml"
    slow.write_text('base = "haptable"\nname = "slow"\n[daq]\nai_conv_rate = 20000\n')
    found = []
    for file in ("haptable", slow):
        with haploop.open_rig(file, simulate=simulate, simulation={"faults": [fault]}) as rig:
            found.append(len(list(check_ghosts(rig, [("switch", "acceleration_x")]))))
    assert found == [1, 0]
