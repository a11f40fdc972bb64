"""Test whether a rig is wired and set as its file says.

Tests that move nothing come first, then the relay with the amplifier at zero, then short sweeps of a
few volts within the rig's own limits. The rig is in its safe state after each part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import numpy as np

from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.progress import Progress, silent
from ...instruments import Rig, RigFile
from ...instruments.driver import Mode
from ...instruments.operator import UnansweredError
from ...instruments.relay import LOST
from ...instruments.rig import UNPROVED, identify_each
from ...instruments.vibrometer import Vibrometer, shown
from ..drive import Drive
from .finding import Finding, Status
from .loop_test import check_ghosts
from .patch_test import check_patches
from .sensor_test import (
    cards,
    check_camera,
    check_clock,
    check_force,
    check_gravity,
    check_noise,
    check_streams,
)
from .verdict_test import check_bands, check_verdicts

NO_DRIVES: Mapping[str, Drive] = MappingProxyType({})
_DIVIDER = 100.0
"""Ratio of the usual divider of a drive monitor (docs/hardware.md, "divider at the patches")."""
_SAME = 0.01
"""Relative difference below which two factors are one."""


def examine(
    rig: Rig, mass: float = 0.5, progress: Progress = silent, drives: Mapping[str, Drive] = NO_DRIVES
) -> list[Finding]:
    """Test every instrument and sensor of this rig, beginning with the tests that move nothing.

    `mass` (kg) is the mass that the operator is asked to put on the force sensor; of `drives`, by name, is
    told which error a check can decide. `progress` is called
    before and after each part. A safe state that is not confirmed is the last finding. Raises
    ConfigurationError for a mass that is none.

    For example:

        >>> [finding.sentence for finding in haploop.examine(rig) if finding.status == "red"]
        []
    """
    if not 0 < mass < math.inf:
        raise ConfigurationError(f"{mass} kg is no mass for a force sensor: use one of 0.05 to 10 kg.")
    parts: list[tuple[str, str, bool, Callable[[], Iterator[Finding]]]] = [
        ("Identities", "rig", True, lambda: _identities(rig)),
        ("Settings", "rig", True, lambda: _settings(rig)),
        ("Bandwidth", "daq", True, lambda: check_bands(rig)),
        ("Noise floor", "daq", True, lambda: check_noise(rig)),
        ("Ghosts", "daq", True, lambda: check_ghosts(rig, list(cards(rig).values()))),
        ("Force sensor", "force", rig.sensors.force is not None, lambda: check_force(rig, mass)),
        ("Accelerometer", "acceleration", rig.sensors.acceleration is not None, lambda: check_gravity(rig)),
        ("Camera", "camera", rig.has("camera"), lambda: check_camera(rig)),
        ("Streams", "streams", rig.has("streams"), lambda: check_streams(rig)),
        ("Two cards, one clock", "daq", len(cards(rig)) > 1, lambda: check_clock(rig)),
        ("Relay", "relay", rig.file.relay is not None, lambda: _relay(rig)),
        ("Patches", "table", _has_table(rig), lambda: check_patches(rig)),
        ("Verdicts", "vibrometer", _has_table(rig), lambda: check_verdicts(rig, drives)),
    ]
    findings: list[Finding] = []
    for name, instrument, applies, check in parts:
        if not applies:
            continue
        if name == "Patches" and any(f.instrument == "relay" and f.status == "red" for f in findings):
            findings.append(Finding(name, instrument, "yellow", "Not tested: repair the relay first."))
            continue
        progress(name, 0, 1, "")
        try:
            findings.extend(check())
        except UnansweredError as error:
            findings.append(Finding(name, instrument, "yellow", f"Not tested: {error}"))
        except HaploopError as error:
            findings.append(Finding(name, instrument, "red", str(error)))
        finally:
            unsafe = _made_safe(rig)
        progress(name, 1, 1, "")
        if unsafe:
            return [*findings, *unsafe]
    if rig.file.relay is not None:
        held = ", ".join(sorted(rig.relay.connected()))
        findings.append(
            Finding("Safe state", "rig", "red", f"The relay still connects {held}: switch the amplifier off.")
            if held
            else Finding("Safe state", "rig", "green", "The output is zero and every relay channel is open.")
        )
    elif _is_direct(rig):
        read = rig.daq.outputs_read()
        how = (
            "is zero, read back"
            if read
            else "was set to zero, and is not read back: this card cannot, or its driver does not"
        )
        sentence = f"The output {how}; the actuator stays connected."
        findings.append(Finding("Safe state", "rig", "green", sentence))
    return findings


def _made_safe(rig: Rig) -> list[Finding]:
    """Reach the safe state; what there is to say when it was not confirmed, and nothing more is tested."""
    try:
        rig.make_safe()
    except HaploopError as error:
        return [
            Finding(
                "Everything else", "rig", "yellow", "Not tested, because the safe state was not confirmed."
            ),
            Finding("Safe state", "rig", "red", str(error)),
        ]
    return []


def examine_each(
    file: RigFile, simulate: Mode | None, error: HaploopError, *, plant: object = None
) -> list[Finding]:
    """Open each instrument by itself, for a rig that cannot be opened because of `error`.

    `simulate` and `plant` as they were given to `open_rig`.
    """
    findings: list[Finding] = []
    try:
        for role, outcome, asked in identify_each(file, simulate, plant=plant):
            if role == "operator":
                continue
            failed = isinstance(outcome, HaploopError)
            named = f"{outcome} responds." if asked else f"{outcome}: no digital interface; it was not asked."
            sentence = str(outcome) if failed else named
            findings.append(Finding("Identity", role, "red" if failed else "green", sentence))
    except HaploopError as problem:
        findings.append(Finding("Identity", "rig", "red", str(problem)))
    if all(finding.status == "green" for finding in findings):
        findings.append(Finding("Identity", "rig", "red", str(error)))
    findings.append(Finding("Everything else", "rig", "yellow", "Not tested: the rig could not be opened."))
    return findings


def _has_table(rig: Rig) -> bool:
    file = rig.file
    parts = (file.table, file.actuator, file.amplifier, file.vibrometer, file.sensors.drive)
    return all(part is not None for part in parts) and (file.relay is not None or _is_direct(rig))


def _is_direct(rig: Rig) -> bool:
    return rig.file.wiring == "direct" and rig.has("relay")


def _identities(rig: Rig) -> Iterator[Finding]:
    for role, instrument in rig.instruments.items():
        if role in ("operator", "streams") or (role == "relay" and rig.file.relay is None):
            continue  # streams are looked for below
        sentence = f"{_identity(rig, role)} responds."
        if role == "amplifier":
            below = "; its gain is measured below" if rig.sensors.drive else ""
            sentence = f"{instrument.identity}: no digital interface{below}."
        elif role == "vibrometer" and instrument.declared is not None:
            sentence = f"{instrument.identity}: no digital interface; the operator confirms its settings."
        yield Finding("Identity", role, "green", sentence)


def _identity(rig: Rig, role: str) -> str:
    """Identity of an instrument; a driver from another package may have none."""
    return getattr(rig.instruments[role], "identity", f"The {role}")


def _settings(rig: Rig) -> Iterator[Finding]:
    if rig.file.vibrometer is not None:
        yield _vibrometer_settings(rig)
        if rig.vibrometer.mass:
            yield _loaded(rig.vibrometer)
    if _has_table(rig):
        yield _limits(rig)
    for role, device in rig.file.devices.items():
        if "rating_source" in device.settings:
            sentence = (
                f"The rig file gives the {role} figures that are not its product's own: "
                f"{device.settings['rating_source']}."
            )
            yield Finding("Ratings", role, "yellow", sentence)
    if (why := rig.file.abort.drive_source) is not None:
        sentence = f"[abort] drive lets {rig.file.abort.drive:g} V pass, which is beyond the limits: {why}."
        yield Finding("Ratings", "abort", "yellow", sentence)
    if rig.file.amplifier is not None:
        yield from _provable(rig)
    if _is_direct(rig):
        yield from _without_relay(rig)
    if rig.file.relay is not None and math.isfinite(rig.relay.dead_man):
        sentence = (
            f"If this program is killed or loses power, the relay box opens by itself after "
            f"{rig.relay.dead_man:g} s."
        )
        yield Finding("Dead-man time", "relay", "green", sentence)
    lockout = rig.lockout
    if lockout is not None:
        yield Finding("Lockout", "rig", "red", lockout.sentence)
    elif _has_table(rig):
        sentence = f"The rig is not locked out; its audit log is in {rig.audit.folder}."
        yield Finding("Lockout", "rig", "green", sentence)


def _without_relay(rig: Rig) -> Iterator[Finding]:
    """What is lost without a relay, and what a voltage that stays would do to a coil."""
    actuator, peak = rig.actuator, rig.limits.peak
    sentence = LOST
    held = actuator.held_watts(peak)
    if actuator.watts is not None and held > actuator.watts:
        sentence += (
            f" A drive of up to {peak:g} V that stays would make the coil dissipate {held:.3g} W, and it "
            f"takes {actuator.watts:g} W: put a thermal fuse in series, or a capacitor."
        )
    if rig.feeds_amplifier("player"):
        sentence += (
            f" Every sound that another program plays on the {rig.player.identity} reaches the actuator."
        )
    if actuator.protected_by:
        sentence += f" The rig file says what protects it: {actuator.protected_by}."
    yield Finding("No relay", "amplifier", "yellow", sentence)


def _provable(rig: Rig) -> Iterator[Finding]:
    """Findings on figures that the proof of the amplifier's gain cannot tell to be wrong."""
    divider, own = rig.sensors.drive, rig.amplifier.own_gain
    if divider is None:
        yield Finding("Gain", "amplifier", "yellow", UNPROVED)
        return
    if own is None:
        return
    gain = 1 / float(rig.amplifier.to_input(np.ones(1))[0])
    factor = gain / own
    if abs(factor - 1) > _SAME and math.isclose(divider.ratio / _DIVIDER, factor, rel_tol=_SAME):
        sentence = (
            f"gain = {gain:g} in [amplifier] and ratio = {divider.ratio:g} in [sensors.drive] are both "
            f"{factor:.3g} times what is usual ({own:g} and {_DIVIDER:g}): they agree with each other, and "
            f"if both are wrong a patch gets {1 / factor:.3g} times the volts of a drive. Measure a patch's "
            "volts with another instrument."
        )
        yield Finding("Gain", "amplifier", "yellow", sentence)


def _limits(rig: Rig) -> Finding:
    limits, abort = rig.limits, rig.file.abort
    sentence = (
        f"A drive may reach {limits.peak:g} V about zero, slew {limits.slew:g} V/s, draw "
        f"{limits.current_peak:g} A and last {limits.max_duration:g} s, {limits.duty:.0%} of a minute: the "
        f"strictest of amplifier{'' if rig.file.relay is None else ', relay'}, actuator and rig."
    )
    aborts = [f"{1.1 * limits.peak if abort.drive is None else abort.drive:.3g} V at the patch"]
    aborts += [f"{abort.velocity:g} m/s of the surface"] if abort.velocity is not None else []
    aborts += [f"{abort.displacement:g} m of the surface"] if abort.displacement is not None else []
    aborts += [f"{abort.acceleration:g} m/s² of the surface"] if abort.acceleration is not None else []
    aborts += [f"{abort.force:g} N on the force sensor"] if abort.force is not None else []
    return Finding("Limits", "amplifier", "green", f"{sentence} A play is stopped at {', '.join(aborts)}.")


def _vibrometer_settings(rig: Rig) -> Finding:
    vibrometer = rig.vibrometer
    full, per_volt = (shown(vibrometer.quantity, value) for value in (vibrometer.range, vibrometer.scale))
    settings = f"{full} full scale ({per_volt} per V)"
    if vibrometer.declared is not None:
        try:
            rig.confirm_settings()
        except UnansweredError:
            sentence = f"Not tested: nobody was there to confirm {settings}. Run this at a terminal."
            return Finding("Settings", "vibrometer", "yellow", sentence)
        except InstrumentError:
            sentence = (
                f"The settings differ from the rig file, so every {vibrometer.quantity} would be scaled "
                f"wrongly: set the range to {full} and the filters as prompted, or correct [vibrometer]."
            )
            return Finding("Settings", "vibrometer", "red", sentence)
        return Finding("Settings", "vibrometer", "green", f"The operator confirms {settings}.")
    assert rig.file.vibrometer is not None
    for key in ("range", "scale"):
        asked = rig.file.vibrometer.settings.get(key)
        found = getattr(vibrometer, key)
        if isinstance(asked, float) and not math.isclose(asked, found, rel_tol=1e-3):
            sentence = (
                f"The instrument reports a {key} of {found:g}, but the rig file says {asked:g}: set the "
                "instrument, or correct [vibrometer]."
            )
            return Finding("Settings", "vibrometer", "red", sentence)
    level = vibrometer.signal_level()
    if level is not None and level < 0.3:
        status: Status = "red" if level < 0.1 else "yellow"
        sentence = f"The signal level is {level:.0%}: focus the laser, or put reflective tape on the table."
        return Finding("Settings", "vibrometer", status, sentence)
    seen = "" if level is None else f"; signal level {level:.0%}"
    return Finding("Settings", "vibrometer", "green", f"The instrument reports {settings}{seen}.")


def _loaded(pickup: Vibrometer) -> Finding:
    sentence = (
        f"The {pickup.identity} adds {pickup.mass * 1e3:g} g to the table where it is glued: a mode falls by "
        "half of the ratio of this to the mass that moves there. Calibrate, make buttons and check with it "
        "in place, and do not move it in between."
    )
    return Finding("Mass", "vibrometer", "yellow", sentence)


def _relay(rig: Rig) -> Iterator[Finding]:
    relay = rig.relay
    rig.daq.zero()
    sound = True
    for patch in relay.patches:
        name = f"Channel of patch {patch}"
        try:
            relay.connect((patch,))
            shown = relay.connected()
            relay.connect(())
            left = relay.connected()
        except InstrumentError as error:
            sound = False
            yield Finding(name, "relay", "red", str(error))
            continue
        if shown == {patch} and not left:
            yield Finding(
                name, "relay", "green", "Closes alone and opens again, read back with the output at zero."
            )
        else:
            sound = False
            states = ", ".join(sorted(shown)) or "nothing"
            sentence = f"Commanded to connect {patch} alone, the box reports {states}: check or replace it."
            yield Finding(name, "relay", "red", sentence)
    complaint = relay.power_on_complaint()
    if complaint:
        yield Finding("At power-on", "relay", "red", complaint)
    if sound:
        yield _dead_man(rig)


def _dead_man(rig: Rig) -> Finding:
    relay, patch = rig.relay, rig.relay.patches[0]
    if math.isinf(relay.dead_man):
        return Finding(
            "Dead-man",
            "relay",
            "yellow",
            "The relay has no dead-man timer: if this computer stops, a connected patch stays connected. "
            "Switch the amplifier off by hand in that case.",
        )
    relay.connect((patch,))
    rig.clock.sleep(relay.dead_man + 0.5)
    if relay.connected():
        sentence = (
            f"Patch {patch} is still connected {relay.dead_man + 0.5:g} s after the last command: the box "
            "does not open by itself. Update its firmware, or replace it."
        )
        return Finding("Dead-man", "relay", "red", sentence)
    sentence = f"Without renewal, the box opened by itself within {relay.dead_man:g} s."
    return Finding("Dead-man", "relay", "green", sentence)
