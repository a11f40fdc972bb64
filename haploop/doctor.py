"""`haploop doctor`: is this rig wired and set as its file says? A sentence for each thing it looks at.

It begins with what moves nothing, then switches the relay with the amplifier at zero, and at last
plays short sweeps of a few volts through the rig's own limits. After each part the rig is in its
safe state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import get_args

from rich.markup import escape
from rich.table import Table

from haploop.console import print_json, print_table
from haploop.finding import Finding, Status
from haploop.patch_check import judge_patches
from haploop.sensor_check import cards, judge_clock, judge_force, judge_gravity, judge_noise
from instruments import (
    HaploopError,
    InstrumentError,
    Rig,
    RigFile,
    open_rig,
)
from instruments.driver import Mode
from instruments.rig_file import ROLES

__all__ = ["Finding", "examine", "find_each", "tell"]

_STATUSES = get_args(Status)

Progress = Callable[[str, float, float], None]


def examine(
    rig: Rig, mass: float = 0.5, progress: Progress = lambda _step, _done, _of: None
) -> list[Finding]:
    """Look at everything that this rig has, in an order that moves as little as possible.

    `mass` (kg) is what the operator is asked to put on the force sensor. `progress` is told each
    part's name, and what is done of how much. Raises InstrumentError only when the safe state could
    not be confirmed.
    """
    parts: list[tuple[str, str, bool, Callable[[], Iterator[Finding]]]] = [
        ("Identities", "rig", True, lambda: _identities(rig)),
        ("Settings", "rig", True, lambda: _settings(rig)),
        ("Noise floor", "daq", True, lambda: judge_noise(rig)),
        ("Force sensor", "force", rig.sensors.force is not None, lambda: judge_force(rig, mass)),
        ("Accelerometer", "acceleration", rig.sensors.acceleration is not None, lambda: judge_gravity(rig)),
        ("Two cards, one clock", "daq", len(cards(rig)) > 1, lambda: judge_clock(rig)),
        ("Relay", "relay", rig.file.relay is not None, lambda: _relay(rig)),
        ("Patches", "table", _has_table(rig), lambda: judge_patches(rig)),
    ]
    findings: list[Finding] = []
    for name, instrument, applies, judge in parts:
        if not applies:
            continue
        if name == "Patches" and any(f.instrument == "relay" and f.status == "red" for f in findings):
            findings.append(
                Finding(
                    name, instrument, "yellow", "Not judged: the relay comes first, mend what is red there."
                )
            )
            continue
        progress(name, 0, 1)
        try:
            findings.extend(judge())
        except HaploopError as error:
            findings.append(Finding(name, instrument, "red", str(error)))
        finally:
            rig.make_safe()
        progress(name, 1, 1)
    if rig.file.relay is not None:
        held = ", ".join(sorted(rig.relay.connected()))
        findings.append(
            Finding("Safe state", "rig", "red", f"The relay still connects {held}: switch the amplifier off.")
            if held
            else Finding(
                "Safe state", "rig", "green", "The output is at zero and every relay channel is open."
            )
        )
    return findings


def find_each(file: RigFile, simulate: Mode | None, error: HaploopError) -> list[Finding]:
    """For a rig that does not open, with `error`: which instruments are there, each opened by itself."""
    findings: list[Finding] = []
    roles = [role for role in ROLES if role != "operator" and getattr(file, role) is not None]
    # A plant is wired to the cards: simulated, the others cannot be opened without them.
    needed = "daq" if simulate or file.simulate else ""
    for role in roles:
        if findings and findings[0].status == "red" and needed:
            findings.append(Finding("Identity", role, "yellow", "Not judged: the DAQ comes first."))
            continue
        alone = file.model_copy(update={other: None for other in roles if other not in (role, needed)})
        try:
            with open_rig(alone, simulate=simulate) as rig:
                identity = getattr(rig, role).identity
                findings.append(Finding("Identity", role, "green", f"{identity} is there."))
        except HaploopError as problem:
            findings.append(Finding("Identity", role, "red", str(problem)))
    if all(finding.status == "green" for finding in findings):
        findings.append(Finding("Identity", "rig", "red", str(error)))
    findings.append(
        Finding(
            "Everything else", "rig", "yellow", "Not judged: a rig that does not open cannot be measured."
        )
    )
    return findings


def tell(findings: Sequence[Finding], rig: str, simulated: bool, as_json: bool) -> None:
    """Print findings on standard output: a table, or one JSON object."""
    worst = max((finding.status for finding in findings), key=_STATUSES.index)
    if as_json:
        found = [asdict(finding) for finding in findings]
        print_json({"rig": rig, "simulated": simulated, "status": worst, "findings": found})
        return
    table = Table(
        "",
        "instrument",
        "what",
        "finding",
        title=f"The rig {rig}{', simulated' if simulated else ''}: {worst}",
    )
    for finding in findings:
        mark = f"[{finding.status}]{finding.status}[/{finding.status}]"
        table.add_row(mark, finding.instrument, finding.name, escape(finding.sentence))
    print_table(table)


def _has_table(rig: Rig) -> bool:
    file = rig.file
    parts = (file.table, file.amplifier, file.relay, file.vibrometer, file.sensors.drive)
    return all(part is not None for part in parts)


def _identities(rig: Rig) -> Iterator[Finding]:
    for role in ROLES:
        if role == "operator" or getattr(rig.file, role) is None:
            continue
        instrument = getattr(rig, role)
        sentence = f"{instrument.identity} is there."
        if role == "amplifier":
            sentence = f"{instrument.identity}: it has no interface, what it does is measured below."
        elif role == "vibrometer" and instrument.declared is not None:
            sentence = f"{instrument.identity}: it has no interface, its settings are asked for."
        yield Finding("Identity", role, "green", sentence)


def _settings(rig: Rig) -> Iterator[Finding]:
    if rig.file.vibrometer is not None:
        yield _vibrometer_settings(rig)
    if _has_table(rig):
        yield _limits(rig)
    if rig.file.relay is not None and math.isfinite(rig.relay.dead_man):
        sentence = (
            f"Without this program, killed or without power, the box opens by itself after "
            f"{rig.relay.dead_man:g} s."
        )
        yield Finding("Dead-man time", "relay", "green", sentence)
    latch = rig.latch
    if latch is not None:
        yield Finding("Latch", "rig", "red", latch.sentence)
    elif _has_table(rig):
        yield Finding("Latch", "rig", "green", f"It is not latched; its audit log is in {rig.audit.folder}.")


def _limits(rig: Rig) -> Finding:
    limits, abort = rig.limits, rig.file.abort
    sentence = (
        f"A drive may swing {limits.peak:g} V about zero, slew {limits.slew:g} V/s, draw "
        f"{limits.current_peak:g} A and last {limits.burst:g} s, {limits.duty:.0%} of a minute: the "
        "strictest of amplifier, relay, patch and rig."
    )
    watched = [f"{1.1 * limits.peak if abort.drive is None else abort.drive:.3g} V at the patch"]
    watched += [f"{abort.velocity:g} m/s of the surface"] if abort.velocity is not None else []
    watched += [f"{abort.force:g} N on the force sensor"] if abort.force is not None else []
    return Finding("Limits", "amplifier", "green", f"{sentence} A play is stopped at {', '.join(watched)}.")


def _vibrometer_settings(rig: Rig) -> Finding:
    vibrometer = rig.vibrometer
    settings = f"{vibrometer.range * 1e3:g} mm/s full scale ({vibrometer.sensitivity * 1e3:g} mm/s per V)"
    if vibrometer.declared is not None:
        try:
            rig.confirm_settings()
        except InstrumentError:
            sentence = (
                "It is not set as the rig file says, so every velocity would be scaled wrongly: set the "
                f"range to {vibrometer.range * 1e3:g} mm/s and its filters as asked, or correct "
                "[vibrometer]."
            )
            return Finding("Settings", "vibrometer", "red", sentence)
        return Finding("Settings", "vibrometer", "green", f"The operator confirms {settings}.")
    assert rig.file.vibrometer is not None
    for key in ("range", "sensitivity"):
        asked = rig.file.vibrometer.settings.get(key)
        found = getattr(vibrometer, key)
        if isinstance(asked, float) and not math.isclose(asked, found, rel_tol=1e-3):
            sentence = (
                f"It reads back a {key} of {found:g}, and the rig file says {asked:g}: set the instrument, "
                "or correct [vibrometer]."
            )
            return Finding("Settings", "vibrometer", "red", sentence)
    level = vibrometer.signal_level()
    if level is not None and level < 0.3:
        status: Status = "red" if level < 0.1 else "yellow"
        sentence = (
            f"{level:.0%} of the light comes back: focus the laser, or put reflective tape on the table."
        )
        return Finding("Settings", "vibrometer", status, sentence)
    seen = "" if level is None else f", and {level:.0%} of the light comes back"
    return Finding("Settings", "vibrometer", "green", f"It reads back {settings}{seen}.")


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
                name, "relay", "green", "It closes alone and opens again, read back with the output at zero."
            )
        else:
            sound = False
            states = ", ".join(sorted(shown)) or "nothing"
            sentence = f"Told to connect {patch} alone, the box shows {states}: check the box, or replace it."
            yield Finding(name, "relay", "red", sentence)
    if sound:
        yield _dead_man(rig)


def _dead_man(rig: Rig) -> Finding:
    relay, patch = rig.relay, rig.relay.patches[0]
    if math.isinf(relay.dead_man):
        return Finding(
            "Dead-man",
            "relay",
            "yellow",
            "It has none: if this computer stops, a connected patch stays connected. Switch the amplifier "
            "off by hand.",
        )
    relay.connect((patch,))
    rig.clock.sleep(relay.dead_man + 0.5)
    if relay.connected():
        sentence = (
            f"Patch {patch} is still connected {relay.dead_man + 0.5:g} s after the box was last told to: "
            "the box does not open by itself. Update its firmware, or replace it."
        )
        return Finding("Dead-man", "relay", "red", sentence)
    sentence = f"Not renewed, the box opened by itself within its {relay.dead_man:g} s."
    return Finding("Dead-man", "relay", "green", sentence)
