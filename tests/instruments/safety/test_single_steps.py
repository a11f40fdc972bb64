"""Steps that are a single line or sign each: without it, nothing else would be noticed."""

from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.instruments import Limits, open_rig
from haploop.instruments.amplifier.e413 import E413
from haploop.instruments.limits import Coil
from haploop.instruments.relay.board import ChannelRelay
from haploop.instruments.rig.monitoring import loudest, tone
from haploop.instruments.safety import clear_lockout
from tests.instruments.safety.test_limiter import TONE
from tests.instruments.safety.test_other_clients import clients
from tests.instruments.safety.test_permit import RATE, World, rated


@pytest.mark.parametrize("larger", ["one", "two"])
def test_the_warmest_of_several_coils_is_what_is_remembered(tmp_path, larger):
    world, coil = World(tmp_path), Coil(8.0, 0.5e-3, 30.0)
    limits = Limits(min=-50.0, max=50.0, coil=coil, power=1e3)
    amplifier = E413.open(E413.Settings(input={"A": "one", "B": "two"}, gain=50), world.clock)
    large = 20 * np.sin(2 * np.pi * 50 * np.arange(1000) / RATE)
    drives = {"one": large / 10, "two": large / 10} | {larger: large}
    with world.limiter.permit(drives, RATE, ("A", "B"), amplifier, rated(limits)):
        world.clock.sleep(1.0)
    with world.limiter.permit(drives, RATE, ("A", "B"), amplifier, rated(limits)):
        left = world.limiter.warm
    assert left == pytest.approx(limits.heat(large, RATE), rel=0.1)


def test_volts_that_stand_again_soon_after_a_reset_lock_out_again():
    """What is found again while it is locked out is logged seldom; after a reset it is found anew."""
    with open_rig("simulated", simulate="wire") as rig, clients(rig) as (other,):
        for _ in range(4):
            rig.relay.connect(["A"])
            other.reset()
            other.write()
            with pytest.raises(InstrumentError, match="may have got volts"):
                rig.relay.renew()
            assert rig.lockout is not None
            clear_lockout(rig._lockouts.folder, rig.hardware)
            assert rig.lockout is None


def test_the_output_rests_at_zero_before_the_relay_opens(monkeypatch):
    """For several time constants of the amplifier: a patch that is switched under volts clicks."""
    with open_rig("simulated") as rig:
        at: list[tuple[str, float]] = []
        connect, hold = ChannelRelay._connect, rig.daq.hold

        def switched(relay: ChannelRelay, patches: Any) -> None:
            at.append(("close" if patches else "open", rig.clock.now()))
            connect(relay, patches)

        def held() -> None:
            hold()
            at.append(("zero", rig.clock.now()))

        rig.prove_gain("A")
        monkeypatch.setattr(ChannelRelay, "_connect", switched)
        monkeypatch.setattr(rig.daq, "hold", held)
        rig.excite(TONE, ["A"], ["drive"])
        steps = [step for step, _ in at]
        opened = steps.index("open")
        assert steps[opened - 1] == "zero" and at[opened][1] - at[opened - 1][1] > 0.049, at


@pytest.mark.parametrize("rate_hz", [12_345.0, 50_000.0, 2_777.0])
@pytest.mark.parametrize("offset", [-200.0, 0.0, 200.0])
def test_an_offset_of_the_monitor_is_no_volt_of_the_proof(rate_hz, offset):
    assert loudest(tone(1.0, rate_hz) + offset, rate_hz) == pytest.approx(1.0, abs=0.02)
    assert loudest(np.full(round(0.07 * rate_hz), offset), rate_hz) < 1e-6
