"""What a rig file says twice and differently, or what its parts cannot do together.

Each is one clause that says what to write instead. A driver's `Settings` may add its own by a method
`contradictions(file)`, which yields a key of its table and a clause. A part that is missing contradicts
nothing: the step that needs it asks for it.

A sensor and the channel it is wired to may not fit: a channel that the DAQ's table does not describe, or
describes in another package's way, contradicts nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...base.validation import Location
from ...base.wording import did_you_mean
from ..sensors import LinearSensor

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


def contradictions(file: RigFile, settings: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Yield the place and the clause of each; `settings` are the validated ones of the installed drivers."""
    yield from sensor_contradictions(file)
    yield from _of_the_actuator(file)
    takes = file.actuator.limits(1) if file.actuator is not None else file.limits.limits()
    limits = file.limits.limits().within(takes)
    if clause := file.abort.too_high(max(limits.max, -limits.min)):
        yield ("abort", "drive"), clause
    if file.wiring == "direct":
        yield from _of_direct_wiring(file, settings)
    if file.amplifier is not None:
        yield from _of_the_amplifier(file)
    for role, own in settings.items():
        for key, clause in getattr(own, "contradictions", lambda _file: ())(file):
            yield (role, key), clause
    yield from unknown_channels(file)


def range_of(file: RigFile, kind: str, name: str) -> float | None:
    """Range (V) of a channel or output of the DAQ; None where the file says none.

    A DAQ of another package may name its channels in another way.
    """
    known = file.daq.settings.get(kind)
    told = known.get(name) if isinstance(known, Mapping) else None
    given = told.get("range") if isinstance(told, Mapping) else None
    return float(given) if isinstance(given, int | float) else None


def lacks(file: RigFile, kind: str, name: str) -> bool:
    """True when the DAQ's table lists its channels or outputs, and none of this name."""
    known = file.daq.settings.get(kind)
    return isinstance(known, Mapping) and name not in known


def _of_the_actuator(file: RigFile) -> Iterator[tuple[Location, str]]:
    actuator, limits = file.actuator, file.limits
    if actuator is None:
        if file.table is not None:
            yield (
                ("table",),
                'a rig with a [table] needs an [actuator]: write kind = "piezo" with capacitance, min and '
                'max, or kind = "coil" with resistance, volts, watts and thermal_time',
            )
        return
    takes = actuator.limits(1)
    if takes.min == 0:
        yield (
            ("actuator", "min"),
            "an actuator that takes no negative volts cannot follow a drive, which swings about 0 V: write "
            "the negative volts that it takes (min = -20 for many stacks), or use a bipolar one",
        )
    for key, own, most in (("max", limits.max, takes.max), ("min", -limits.min, -takes.min)):
        if key in limits.model_fields_set and own > most:
            sign = "-" if key == "min" else ""
            yield (
                ("limits", key),
                f"{sign}{own:g} V is beyond the {sign}{most:g} V that the actuator takes: write {key} = "
                f"{sign}{most:g}, or correct [actuator]",
            )


def _of_the_amplifier(file: RigFile) -> Iterator[tuple[Location, str]]:
    assert file.amplifier is not None
    amplifier = file.amplifier.settings
    average, peak = amplifier.get("current_average"), amplifier.get("current_peak")
    if isinstance(average, int | float) and isinstance(peak, int | float) and average > peak:
        yield (
            ("amplifier", "current_average"),
            f"{average:g} A on average is more than the {peak:g} A at peak: swap the two, or correct one",
        )
    named = amplifier.get("input")
    fed = list(named.values()) if isinstance(named, Mapping) else [named]
    outputs = file.daq.settings.get("outputs")
    others = [d.settings.get("output") for d in (file.player, file.generator) if d is not None]
    for name in fed:
        if isinstance(outputs, Mapping) and name not in outputs and name not in others:
            have = ", ".join([*outputs, *(str(other) for other in others)]) or "none"
            yield (
                ("amplifier", "input"),
                f"there is no output {name!r} of the DAQ, a player or a generator ({have}): name one of "
                "[daq.outputs]",
            )
    monitor = amplifier.get("monitor")
    channel = monitor.get("channel") if isinstance(monitor, Mapping) else None
    if isinstance(channel, str) and lacks(file, "channels", channel):
        have = ", ".join(file.daq.settings["channels"])
        yield (
            ("amplifier", "monitor"),
            f"there is no channel {channel!r} in [daq.channels] ({have}): name the one that the monitor is "
            "wired to",
        )


def _of_direct_wiring(file: RigFile, settings: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    if file.relay is not None:
        yield (
            ("wiring",),
            'a rig with a [relay] is not wired directly: remove [relay], or write wiring = "relay"',
        )
    patches = file.table.patches if file.table is not None else ("A",)
    if len(patches) != 1:
        yield (
            ("table", "patches"),
            f"direct wiring is one actuator on one amplifier, and {len(patches)} patches are "
            f'named: write patches = ["{patches[0] if patches else "A"}"], or use a relay',
        )
    amplifier = settings.get("amplifier")
    if file.amplifier is None or file.table is None:
        missing = "an [amplifier]" if file.amplifier is None else "a [table]"
        yield ("wiring",), f"direct wiring needs {missing}: add it, or remove wiring"
    elif file.actuator is not None and isinstance(getattr(amplifier, "gain", None), float):
        yield from _unprotected(file, amplifier)


def _unprotected(file: RigFile, amplifier: Any) -> Iterator[tuple[Location, str]]:
    """What the amplifier can put out, when it is more than the actuator takes and nothing protects it."""
    assert file.actuator is not None
    takes = file.actuator.limits(1)
    source = amplifier.input if isinstance(amplifier.input, str) else ""
    most = range_of(file, "outputs", source)
    reach = amplifier.gain * most if most is not None else float("inf")
    low, high = max(amplifier.min, -reach), min(amplifier.max, reach)
    if file.actuator.protected_by is None and (high > takes.max or low < takes.min):
        yield (
            ("amplifier", "gain"),
            f"the amplifier can put out {low:g} to {high:g} V, the actuator takes {takes.min:g} to "
            f"{takes.max:g} V, and no relay lies between: lower the amplifier's gain or rails, or say in "
            '[actuator] what keeps it whole, such as protected_by = "a fuse of 0.5 A"',
        )
