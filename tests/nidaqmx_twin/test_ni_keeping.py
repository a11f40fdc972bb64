"""What the NI system keeps: custom scales, saved tasks, watchdogs and power-up states."""

from collections.abc import Iterator

import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import Edge, Level, PowerUpStates, UnitsPreScaled, VoltageUnits
from nidaqmx.error_codes import DAQmxErrors as Error
from nidaqmx.scale import Scale
from nidaqmx.system import System
from nidaqmx.system.watchdog import DOExpirationState, WatchdogTask
from nidaqmx.types import DOPowerUpState

from haploop.base.clock import VirtualClock
from haploop.nidaqmx_twin import NiServer, devices_from_ini
from tests.nidaqmx_twin.ni_client import EXPORT, FINITE, clocked, code, connected, fails


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def options(clock: VirtualClock) -> Iterator[nidaqmx.GrpcSessionOptions]:
    with NiServer(devices_from_ini(EXPORT), clock=clock) as server, connected(server) as options:
        yield options


def test_scale_of_an_export(options):
    kept = System.remote(options).scales["double"]
    scale = kept.load()
    assert (scale.lin_slope, scale.lin_y_intercept) == (2.0, 1.0)
    assert scale.pre_scaled_units == UnitsPreScaled.VOLTS
    assert kept.author == ""
    assert code(lambda: scale.poly_forward_coeff) == Error.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE


@pytest.mark.parametrize("kind", ["linear", "map", "polynomial", "table"])
def test_a_scale_reads_what_it_writes(options, task, kind):
    {
        "linear": lambda: Scale.create_lin_scale("s", 4, grpc_options=options),
        "map": lambda: Scale.create_map_scale("s", 0, 5, 0, 20, grpc_options=options),
        "polynomial": lambda: Scale.create_polynomial_scale("s", [0, 4], [0, 0.25], grpc_options=options),
        "table": lambda: Scale.create_table_scale("s", [-5, 5], [-20, 20], grpc_options=options),
    }[kind]()
    task.ao_channels.add_ao_voltage_chan(
        "Sim/ao0", min_val=-20, max_val=20, units=VoltageUnits.FROM_CUSTOM_SCALE, custom_scale_name="s"
    )
    with nidaqmx.Task(grpc_options=options) as back:
        back.ai_channels.add_ai_voltage_chan("Sim/_ao0_vs_aognd")
        task.write(10.0)
        assert back.read() == pytest.approx(2.5, abs=2e-3)
    found = Scale.calculate_reverse_poly_coeff([1.0, 2.0], -10.0, 10.0, 1000, 1, grpc_options=options)
    assert found == pytest.approx([-0.5, 0.5])


def test_a_scale_changes_while_it_is_used(options, task):
    scale = Scale.create_lin_scale("s", 1, grpc_options=options)
    channel = task.ai_channels.add_ai_voltage_chan(
        "Sim/ai0", units=VoltageUnits.FROM_CUSTOM_SCALE, custom_scale_name="s", min_val=-10, max_val=10
    )
    assert channel.ai_max == 10
    scale.lin_slope = 2
    assert channel.ai_max == pytest.approx(10)
    assert np.abs(task.read(100)).max() < 10
    channel.ai_max, channel.ai_min = 20, -20
    assert channel.ai_max == 20


def test_saved_task(options):
    system = System.remote(options)
    with nidaqmx.Task("kept", grpc_options=options) as task:
        clocked(task, "Sim/ai0:1", 1000, sample_mode=FINITE, samps_per_chan=20)
        task.save(author="somebody")
        assert code(task.save) == Error.CANT_SAVE_TASK_WITHOUT_REPLACE
    assert system.tasks.task_names == ["kept"]
    assert system.tasks["kept"].author == "somebody"
    with system.tasks["kept"].load() as loaded:
        assert np.shape(loaded.read(20)) == (2, 20)
    system.tasks["kept"].delete()
    assert system.tasks.task_names == []
    with fails(Error.TASK_NOT_IN_DATA_NEIGHBORHOOD):
        nidaqmx.system.storage.PersistedTask("kept", grpc_options=options).load()


def test_watchdog_expires_unless_it_is_told(options, clock):
    with WatchdogTask("Sim", timeout=0.5, grpc_options=options) as dog:
        dog.cfg_watchdog_do_expir_states([DOExpirationState("Sim/port0/line3", Level.TRISTATE)])
        state = dog.expiration_states["Sim/port0/line3"]
        state.do_state = Level.LOW
        assert state.do_state == Level.LOW
        del dog.timeout
        assert dog.timeout == 10
        dog.timeout = 0.5
        assert dog.expir_trig_dig_edge_edge == Edge.RISING
        dog.expir_trig_dig_edge_src = "PFI0"
        assert dog.expir_trig_dig_edge_src == "PFI0"
        with fails(Error.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING):
            _ = dog.expired
        dog.start()
        for _ in range(4):
            clock.sleep_until(clock.now() + 0.4)
            dog.reset_timer()
            assert not dog.expired
        clock.sleep_until(clock.now() + 0.6)
        assert dog.expired
        assert code(dog.reset_timer) == Error.CANT_RESET_EXPIRED_WATCHDOG
        dog.clear_expiration()
        assert not dog.expired
        dog.stop()


def test_a_watchdog_leaves_other_tasks_alone(options, task):
    with (
        WatchdogTask("Sim", timeout=5, grpc_options=options) as dog,
        nidaqmx.Task(grpc_options=options) as follower,
    ):
        dog.start()
        clocked(task, "Sim/ai0", 1000, sample_mode=FINITE, samps_per_chan=10)
        clocked(follower, "Sim/ao0", 1000, source="ai/SampleClock", samps_per_chan=10)
        follower.write(np.zeros(10))
        follower.start()
        assert len(task.read(10)) == 10


def test_power_up_states(options):
    system = System.remote(options)
    system.set_digital_power_up_states("Sim", [DOPowerUpState("Sim/port1", PowerUpStates.LOW)])
    states = {s.physical_channel: s.power_up_state for s in system.get_digital_power_up_states("Sim")}
    assert {s for name, s in states.items() if "port1" in name} == {PowerUpStates.LOW}
    assert {s for name, s in states.items() if "port1" not in name} == {PowerUpStates.TRISTATE}
