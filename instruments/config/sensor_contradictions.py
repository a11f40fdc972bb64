"""What a rig file says of a sensor and of the channel it is wired to, where the two do not fit.

A channel that the DAQ's table does not describe, or describes in another package's way, contradicts nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...base.near_words import did_you_mean
from ..sensors import LinearSensor
from .toml_lines import Location

if TYPE_CHECKING:
    from .rig_file import RigFile

_SLACK = 1.05
"""Part of a channel's range by which a sensor's may exceed it: data sheets round both."""


def sensor_contradictions(file: RigFile) -> Iterator[tuple[Location, str]]:
    """Yield the place and the clause of each."""
    yield from _of_the_terminals(file)
    yield from _of_the_switch(file)
    for quantity, sensor in file.sensors.linear.items():
        yield from _of_the_range(file, quantity, sensor)
        yield from _of_the_coupling(file, quantity, sensor)
    force = file.sensors.force
    if file.abort.force is not None and force is not None and force.ac_coupled:
        yield (
            ("abort", "force"),
            "the force sensor is AC-coupled, and does not show a force that stays: leave abort.force out, or "
            "use a DC-coupled sensor",
        )
    if file.table is not None and file.table.force and (force is None or force.ac_coupled):
        has = "there is no [sensors.force]" if force is None else "the force sensor is AC-coupled"
        yield (
            ("table", "force"),
            f"{has}, and a finger that rests on the table is felt by a DC-coupled sensor: describe one, or "
            "write force = false",
        )


def _told(file: RigFile, channel: str) -> Mapping[str, Any]:
    """What the DAQ's table says of a channel; empty where it says nothing."""
    known = file.daq.settings.get("channels")
    told = known.get(channel) if isinstance(known, Mapping) else None
    return told if isinstance(told, Mapping) else {}


def unknown_channels(file: RigFile) -> Iterator[tuple[Location, str]]:
    """Yield the place and the clause of each channel of a sensor that no DAQ of the file describes."""
    tables = [one.settings.get("channels") for one in (file.daq, file.adc) if one is not None]
    names = [name for table in tables if isinstance(table, Mapping) for name in table]
    if not all(isinstance(table, Mapping) for table in tables):
        return
    sensors = dict(file.sensors.of_presses)
    monitored = file.amplifier is not None and "monitor" in file.amplifier.settings  # it names the drive's
    if file.sensors.drive is not None and not monitored:
        sensors["drive"] = file.sensors.drive
    used: list[tuple[Location, tuple[str, ...]]] = [
        (("sensors", quantity, "channels"), sensor.channels) for quantity, sensor in sensors.items()
    ]
    used += [(("sensors", "extra", name, "channel"), (x.channel,)) for name, x in file.sensors.extra.items()]
    for where, channels in used:
        for name in channels:
            if name not in names:
                known = did_you_mean(name, names, "described are").rstrip(".")
                yield where, f"there is no channel {name!r}; {known}"


def _of_the_switch(file: RigFile) -> Iterator[tuple[Location, str]]:
    switch = file.sensors.activation
    if switch is None:
        return
    most = _told(file, switch.channels[0]).get("range")
    if isinstance(most, int | float) and abs(switch.threshold) >= most:
        yield (
            ("sensors", "activation", "threshold"),
            f"{switch.threshold:g} V is never crossed, because the channel {switch.channels[0]} ends at "
            f"{most:g} V: write a level between those of the open and the closed contact",
        )


def _of_the_terminals(file: RigFile) -> Iterator[tuple[Location, str]]:
    drive = file.sensors.drive
    at: dict[str, str] = {}
    for channel in dict.fromkeys([*file.sensors.recorded, *(drive.channels if drive else ())]):
        terminal = _told(file, channel).get("terminal")
        if isinstance(terminal, str) and (other := at.setdefault(terminal.lower(), channel)) != channel:
            yield (
                ("daq", "channels", channel),
                f"{other} and {channel} are both wired to {terminal}: give each the terminal of its own wire",
            )


def _of_the_range(file: RigFile, quantity: str, sensor: LinearSensor) -> Iterator[tuple[Location, str]]:
    for row, axis in enumerate(sensor.axes):
        used = [column for column, value in enumerate(sensor.matrix[row]) if value]
        if sensor.range is None or len(used) != 1:
            continue
        channel = sensor.channels[used[0]]
        most = _told(file, channel).get("range")
        per_volt, zero = abs(sensor.matrix[row][used[0]]), abs(sensor.zero[used[0]])
        if isinstance(most, int | float) and sensor.range[row] / per_volt + zero > _SLACK * most:
            reach = max(0.0, (most - zero) * per_volt)
            yield (
                ("sensors", quantity, "range"),
                f"at {sensor.range[row]:g} {sensor.unit} along {axis} the sensor puts out "
                f"{sensor.range[row] / per_volt + zero:.3g} V, and the channel {channel} ends at {most:g} V: "
                + (f"write range = {reach:.3g}, or " if reach else "correct its scale or zero, or write ")
                + "a wider range in [daq.channels]",
            )


def _of_the_coupling(file: RigFile, quantity: str, sensor: LinearSensor) -> Iterator[tuple[Location, str]]:
    for channel in sensor.channels:
        told = _told(file, channel)
        if told.get("coupling") == "ac" and not sensor.ac_coupled:
            yield (
                ("sensors", quantity, "channels"),
                f"its channel {channel} is AC-coupled, so that it shows nothing that is constant: write "
                'high_pass_hz (the corner in the card\'s data sheet), or coupling = "dc" in [daq.channels]',
            )
        elif told.get("coupling") == "dc" and told.get("excitation") is not None:
            yield (
                ("daq", "channels", channel),
                "the bias of an IEPE sensor, about 10 V, is beyond a DC-coupled input: write "
                'coupling = "ac", or leave excitation out',
            )
