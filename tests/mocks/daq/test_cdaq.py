"""A rig whose DAQ is modules of a cDAQ chassis is green on the twin and on the wire."""

import pytest

import haploop
from haploop.nidaqmx_twin import inventory_of

RIG = """
name = "cdaq"

[daq]
driver = "ni-daqmx"
devices = { cDAQ1Mod1 = "NI 9215", cDAQ1Mod2 = "NI 9263" }

[daq.channels]
force = { terminal = "cDAQ1Mod1/ai0", range = 10 }
"""


@pytest.mark.parametrize("simulate", ["twin", "wire"])
def test_the_doctor_finds_the_modules_of_a_chassis_green(run, tmp_path, simulate):
    rig = tmp_path / "cdaq.toml"
    rig.write_text(RIG)
    done = run("doctor --rig", rig, "--simulate", simulate, ends=0)
    assert "green" in done.stdout
    with (
        haploop.open_rig(rig, simulate=simulate) as opened,
        opened.daq.stream(["force"], 1000, 100, 200) as stream,
    ):
        assert stream.capture().volts.shape == (1, 200)


def test_a_module_stands_where_its_name_says_and_else_in_the_chassis_that_is_listed():
    named = inventory_of({"cDAQ2Mod3": "NI 9215", "Dev1": "PCIe-6321"}).devices
    assert (named["cDAQ2Mod3"].chassis, named["cDAQ2Mod3"].slot) == ("cDAQ2", 3)
    assert named["cDAQ2"].product.slots
    assert named["Dev1"].chassis is None
    free = inventory_of({"Frame": "cDAQ-9174", "In": "NI 9215", "Out": "NI 9263"}).devices
    assert [(free[name].chassis, free[name].slot) for name in ("In", "Out")] == [("Frame", 1), ("Frame", 2)]
    assert list(free) == ["Frame", "In", "Out"]
